"""Embedded Runge-Kutta pairs over vectors of lanes, for any law of motion."""
