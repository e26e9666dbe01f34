"""Tests of a client are collected where the client is installed.

The extras bring those of `make test`; `make test-clients` makes an environment for each of the
others, whose pins of Gymnasium contradict each other.
"""

from importlib.util import find_spec

NEEDED = {
    "test_minari.py": "minari",
    "test_rl_zoo3.py": "rl_zoo3",
    "test_rllib.py": "ray",
    "test_skrl.py": "skrl",
    "test_sweep.py": "ray",
    "test_stable_baselines3.py": "stable_baselines3",
    "test_tianshou.py": "tianshou",
    "test_torchrl.py": "torchrl",
}

collect_ignore = [file for file, module in NEEDED.items() if find_spec(module) is None]
