"""Analysis of runs and bodies: energy, flow, frequencies, continuous time."""
