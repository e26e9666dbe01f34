"""The linear equations of motion as matrices, in decimal arithmetic."""
