"""What all tests share."""

import gc
import sys

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

# The compiler makes millions of small objects, and every one of numba's defaults' many collections
# looks at all that live: a tenth of the processor time.
gc.set_threshold(50_000, 20, 20)

# The modes and owners of files that it is about are Unix's: Windows has access lists.
collect_ignore = ["packaging/test_cache_trust.py"] if sys.platform == "win32" else []
