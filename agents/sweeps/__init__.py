"""Sweeps: the trainings of many tasks, algorithms, settings and seeds, in processes or on Ray."""
