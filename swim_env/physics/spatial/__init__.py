"""The spatial beam: a chain of rigid elements that turn in all directions, and its step."""
