"""The exponential as a cubic in the generator, for an actuated stretch."""
