"""The paper and this project side by side: its statements measured, its figures redrawn."""
