"""Do the benchmark's kernels written by hand follow the same motion?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks import grid, lanes
from benchmarks.by_hand import rk4, semi_implicit_euler
from benchmarks.recorded import record
from mm_gym import compile_scene

if TYPE_CHECKING:
    from mm_gym import Scene

DRAWN = grid.COMBINATIONS["cubic", "viscous", "small on large", "drawn", "ground noise"]
SCENES = {name: lanes.SCENES[name] for name in ("PreStretch-v0", "Hybrid-v0")} | {
    "noise, a mass each": DRAWN
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_kernels_written_by_hand_converge_to_the_motion(scene: Scene) -> None:
    count = len(compile_scene(scene).actuators)
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


def test_the_grid_compares_at_the_error_that_is_asked_for() -> None:
    rows = grid.rows_of(grid.COMBINATIONS["cubic", "viscous", "none", "drawn", "force"], lanes=32)
    assert [row.tolerance for row in rows] == list(grid.TOLERANCES)
    # The tolerance is that of one of the control steps that the error has gathered in.
    assert all(row.error <= lanes.STEPS * row.tolerance for row in rows)
    asked = [row.asked[1] for row in rows if row.asked]
    assert len(asked) == len(rows)
    assert asked == sorted(asked)
    assert asked[0] < asked[-1]
    # mm_gym is more exact than it was asked to be, which takes as many substeps or more.
    assert all(row.equal[1] >= row.asked[1] for row in rows if row.equal and row.asked)
