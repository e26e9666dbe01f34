"""The action of the exponential on the state, for parameters that differ or change."""
