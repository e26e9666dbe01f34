"""Pictures of episodes: drawn with pygame-ce, which is imported with the first frame."""
