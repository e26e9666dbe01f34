"""Controllers on held-out episodes: costs, tuned baselines and the clairvoyant optimum."""
