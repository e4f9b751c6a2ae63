"""Compilation, threads, dense algebra and elementary functions of the kernels."""
