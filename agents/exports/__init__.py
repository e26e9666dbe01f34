"""Policies as source for other machines."""
