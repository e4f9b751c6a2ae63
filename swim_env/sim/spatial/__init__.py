"""Bodies, simulator and trajectories in space, behind the names that the plane has."""
