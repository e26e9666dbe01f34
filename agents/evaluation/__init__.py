"""Controllers on held-out episodes: scores, baselines and the best known plan."""
