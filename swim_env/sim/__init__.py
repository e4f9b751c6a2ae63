"""Bodies that move: the batch, the simulator, recorded runs."""
