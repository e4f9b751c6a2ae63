"""Frames of the environments, drawn with Pillow, and the window that shows them."""
