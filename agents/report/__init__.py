"""Figures, tables and pages from evaluations."""
