"""Studies of the project itself: what things cost, how exact they are, and how they compare."""
