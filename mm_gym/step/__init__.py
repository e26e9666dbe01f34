"""A control step: command, excite, move, observe, score, end, restart; and closed loops."""
