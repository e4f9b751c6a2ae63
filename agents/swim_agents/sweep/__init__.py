"""Sweeps: one command with many settings, a folder and a row of a table for each run."""
