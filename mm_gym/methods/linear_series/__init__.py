"""Taylor series of a linear plant's motion."""
