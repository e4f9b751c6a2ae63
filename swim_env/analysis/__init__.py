"""What a run or a body tells: energy, flow, frequencies, continuous time."""
