"""What everything costs: the physics step and its parts, environments, start-up, and the peers."""
