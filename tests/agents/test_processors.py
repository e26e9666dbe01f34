"""A search repeats bit by bit, whatever processor its kernels are compiled for."""

from kernel_modules import start

PROCESSORS = ("generic", "")
"""The least that can be named, without fused products on x86, and the one that tests run on."""

NETWORK = """
import numpy as np
from agents.evolution.network_kernel import forward

n, hidden, k, units, m, candidates, lanes = 5, 7, 2, 2, 3, 3, 37
draw = np.random.default_rng(0)
size = units * 2 * (n + m) + k * (1 + n + m + units) + hidden * (1 + n + m + units + k)

def drawn(*shape):
    return draw.normal(0.0, 0.5, shape).astype(np.float32)

fixed = np.abs(drawn(units, 4)), drawn(m, m), drawn(m, n), drawn(m, k)
parameters = drawn(candidates, size)
sums = np.zeros((2 * units + m + k, candidates * lanes), np.float32)
memory = np.zeros((n + m + units + 2, lanes), np.float32)
actions = np.zeros((k, candidates * lanes), np.float32)
for _ in range(20):
    observed = drawn(n, candidates * lanes)
    forward(observed, actions, parameters, fixed, sums, memory, (n, hidden, k))
    print(actions.tobytes().hex(), sums.tobytes().hex())
"""

EVOLUTION = """
import os
from pathlib import Path
from agents.evolution.search import evolve
from agents.evolution.search import EvolveSettings
from agents.training.runs import Run

settings = EvolveSettings(
    task="mm_gym/PreStretchShock-v0",
    name="search", candidates=8, episodes=4, generations=6, evaluations=2, hidden=4, threads=1,
)
run = Run("search", Path(os.environ["NUMBA_CACHE_DIR"]))
evolve(settings, run, bar=False)
print(run.metrics.read_text())
"""


def outputs(program, folder):
    """What a program prints, compiled for each processor."""
    for processor in PROCESSORS:
        place = {"NUMBA_CPU_NAME": processor, "NUMBA_CACHE_DIR": str(folder / (processor or "own"))}
        process = start(program, folder=folder, **place)
        out, err = process.communicate()
        assert process.returncode == 0, err
        yield out


def test_network_of_the_search_has_the_same_outputs_on_every_processor(tmp_path):
    general, own = outputs(NETWORK, tmp_path)
    assert len(own) > 1000
    assert general == own


def test_search_has_the_same_costs_on_every_processor(tmp_path):
    general, own = outputs(EVOLUTION, tmp_path)
    assert own.count("\n") > 2
    assert general == own
