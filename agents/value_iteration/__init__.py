"""Value iteration on a grid: the best law that does not know what is to come."""
