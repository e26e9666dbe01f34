"""Motions from kernels: lanes side by side, simulations, trajectories and their energy."""
