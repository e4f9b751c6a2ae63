"""The hard cases: what is asked of the solver, what it does, and the table of both."""
