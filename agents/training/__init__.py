"""Training: settings, run folders and algorithms."""
