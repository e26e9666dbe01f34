"""Figures, tables and pages made from evaluations."""
