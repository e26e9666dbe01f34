"""Runge-Kutta and semi-implicit Euler with fixed substeps, for comparison."""
