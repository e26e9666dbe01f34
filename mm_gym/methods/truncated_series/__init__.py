"""A Taylor series with as many terms as the tolerance asks for, for an actuated stretch."""
