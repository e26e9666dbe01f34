"""Transition matrices for linear plants."""
