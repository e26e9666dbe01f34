"""What all tests share."""

import gc
import os
import sys
from collections import Counter
from pathlib import Path

import pytest
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

# The compiler makes millions of small objects: after every 700, the default, Python looks for
# garbage in vain, which takes a fifth of the time in which tests are collected.
gc.set_threshold(50_000, 20, 20)

# The modes and owners of files that it is about are Unix's: Windows has access lists.
collect_ignore = ["packaging/test_cache_trust.py"] if sys.platform == "win32" else []

LONGEST = {
    "test_aggregates.py",
    "test_bounds.py",
    "test_comparison.py",
    "test_controllers.py",
    "test_every_command.py",
    "test_evolution.py",
    "test_excitation.py",
    "test_force_between_masses.py",
    "test_gradient.py",
    "test_headroom.py",
    "test_interfaces.py",
    "test_kernel_cache.py",
    "test_linear_springs.py",
    "test_magnetorheological.py",
    "test_metrics.py",
    "test_own_reward.py",
    "test_semi_active_damping.py",
    "test_splitting.py",
    "test_training.py",
    "test_tune.py",
    "test_vector_wrappers.py",
}
"""Files that take 20 s of a processor or more, with a cold cache."""


SLOW = (Path(__file__).parent / "slow.txt").read_text("utf-8").splitlines()
"""Tests that `make test-slow` runs: long ones, and those for which alone a law of motion is
compiled. `make test` runs cheaper cases of most, and other laws. A test alone stands for all its
parameters, and a star at the end for any ending."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """Return the number of workers: one more than processors.

    Workers wait for kernels that another one compiles, and for the processes of some tests.
    """
    return len(os.sched_getaffinity(0)) + 1 if hasattr(os, "sched_getaffinity") else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark slow tests. Begin with the longest files, then with those of most tests."""
    found = {item.nodeid: item for item in items}
    files = {item.nodeid.partition("::")[0] for item in items}
    are_whole = not any("::" in argument for argument in config.args)
    for one in SLOW:
        starts = one.removesuffix("*") if one.endswith("*") else f"{one}["
        known = [item for name, item in found.items() if name == one or name.startswith(starts)]
        for item in known:
            item.add_marker(pytest.mark.slow)
        if not known and are_whole and one.partition("::")[0] in files:
            msg = f"tests/slow.txt: there is no test {one}"
            raise pytest.UsageError(msg)
    tests = Counter(item.path for item in items)
    # So workers end together.
    items.sort(key=lambda item: (item.path.name not in LONGEST, -tests[item.path]))
