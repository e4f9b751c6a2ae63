"""The planar beam and its step equations."""
