"""The law of motion: forces, regimes and equations, for any method and kind of number."""
