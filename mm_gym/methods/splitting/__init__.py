"""Extrapolated splitting, for a cubic spring at rates that a control step resolves."""
