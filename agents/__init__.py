"""Controllers for mm_gym, their training and their evaluation.

Run from the checkout: ``python -m agents.train``.
"""
