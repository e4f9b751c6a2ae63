"""Analysis of runs and bodies: energy, flow, natural frequencies."""
