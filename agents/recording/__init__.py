"""Datasets of episodes: how they are played, by which law, and how they are written."""
