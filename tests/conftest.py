"""What all tests share."""

from hypothesis import HealthCheck, settings

# The same examples on every run, and no deadline: the first example compiles the kernels. Examples
# are drawn in the time that other processes leave, so their slowness is no failure either.
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    max_examples=20,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")
