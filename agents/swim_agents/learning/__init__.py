"""Training agents with stable-baselines3: configuration, runs that survive a kill, saved agents."""
