"""Comparing agents with the paper's travelling wave: figures, gaits, tables and pictures."""
