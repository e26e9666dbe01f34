"""Searches around a law: how networks begin, and rounds that any kill leaves resumable."""
