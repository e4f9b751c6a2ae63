"""Scenes of bodies that move in three dimensions."""
