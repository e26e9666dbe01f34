"""What all tests share."""

from hypothesis import settings

# The same examples on every run, and no deadline: the first example compiles the kernels.
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=20)
settings.load_profile("repeatable")
