"""What excites a scene, as it runs: its kinds, and the polynomials that methods read."""
