"""The law of motion, written once in the form of values, for any method and kind of number."""
