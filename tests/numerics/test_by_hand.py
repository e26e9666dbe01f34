"""Do the benchmark's kernels written by hand follow the same motion?"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import lanes
from benchmarks.by_hand import rk4, semi_implicit_euler
from benchmarks.recorded import record


@pytest.mark.parametrize("name", ["PreStretch-v0", "Hybrid-v0"])
def test_kernels_written_by_hand_converge_to_the_motion(name: str) -> None:
    scene = lanes.SCENES[name]
    count = (scene.actuation.force is not None) + (scene.actuation.stretch is not None)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (lanes.STEPS, 16, count))
    recorded = record(scene, actions.astype(np.float32))
    errors = [
        [
            lanes.error_of(lanes.by_hand(family, "", block, substeps, recorded))
            for substeps in (16, 64)
        ]
        for family, block in ((lanes.RK4, rk4(scene)), (lanes.EULER, semi_implicit_euler(scene)))
    ]
    orders = np.log(np.divide(*np.transpose(errors))) / np.log(4.0)
    assert orders == pytest.approx([4.0, 1.0], abs=0.3)
    assert max(error[1] for error in errors) < 0.02
