"""The sections of the page, each from the data alone."""
