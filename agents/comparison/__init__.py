"""Several controllers on several tasks: what is compared, measured and concluded."""
