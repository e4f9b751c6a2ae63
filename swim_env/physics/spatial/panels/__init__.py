"""Panels on the surface of the spatial body: influence, added mass, shape derivative."""
