"""What the sections of ``page.md`` are filled with: from the data to fields, None where missing."""
