"""Adaptive Taylor series, for every plant with two masses."""
