"""The options of the solver mean the same in simulations and in both environments."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mm_gym import (
    CompileError,
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    compile_scene,
    simulate,
)

if TYPE_CHECKING:
    from collections.abc import Callable

LINEAR = Scene(
    initial={"carriage_displacement": 0.01, "sphere_offset": 0.02},
    actuation={"force": {"limit": 4.0}},
    control={"time_step": 0.01, "steps": 20},
)
FRICTION = LINEAR.replace(
    interface={
        "kind": "dry_friction",
        "static_coefficient": 0.5,
        "kinetic_coefficient": 0.25,
        "reference_velocity": 0.2,
    }
)
CUBIC = LINEAR.replace(**{"carriage.cubic_coefficient": 2e6})
TUNED = LINEAR.replace(springs={"kind": "small_on_large"}, **{"actuation.stretch": {}})
ACTION = np.array([0.5], np.float32)

SHELLS: dict[str, Callable[[Scene], object]] = {
    "compile_scene": compile_scene,
    "simulate": lambda scene: simulate(scene, duration=0.05),
    "single": MovingMassEnv,
    "vector": lambda scene: MovingMassVectorEnv(scene, 3),
}


@pytest.mark.parametrize(
    ("scene", "solver"),
    [
        (LINEAR, {}),
        (LINEAR, {"method": "exact"}),
        (LINEAR, {"method": "taylor", "tolerance": 1e-3}),
        (LINEAR, {"method": "rk4", "substeps": 3}),
        (LINEAR, {"method": "semi_implicit_euler", "substeps": 7}),
        (FRICTION, {"method": "switched"}),
        (FRICTION, {"method": "taylor", "tolerance": 1e-4}),
        (CUBIC, {"tolerance": 1e-2}),
        (CUBIC, {"tolerance": 1e-12}),
        (CUBIC, {"method": "rk4", "substeps": 64}),
    ],
    ids=str,
)
def test_setting_gives_the_same_states_everywhere(scene: Scene, solver: dict[str, object]) -> None:
    asked = scene.replace(solver=solver)
    states = simulate(asked, action=2.0, seed=0).state
    single, vector = MovingMassEnv(asked), MovingMassVectorEnv(asked, 3)
    single.reset(seed=0)
    vector.reset(seed=0)
    for state in states[1:]:
        assert np.array_equal(single.step(ACTION)[4]["state"], state)
        info = vector.step(np.tile(ACTION, (3, 1)))[4]
        assert np.array_equal(info["state"], np.tile(state, (3, 1)))
    # It is the setting asked for: another one gives other digits.
    if solver:
        other = {"method": "taylor", "tolerance": 1e-1}
        others = simulate(scene.replace(solver=other), action=2.0, seed=0).state
        assert not np.array_equal(states, others)


@pytest.mark.parametrize("shell", list(SHELLS))
@pytest.mark.parametrize(
    ("scene", "solver", "option"),
    [
        (LINEAR, {"tolerance": 1e-6}, "tolerance"),
        (LINEAR, {"substeps": 3}, "substeps"),
        (FRICTION, {"method": "switched", "tolerance": 1e-6}, "tolerance"),
        (CUBIC, {"substeps": 3}, "substeps"),
        (CUBIC, {"method": "rk4", "substeps": 64, "tolerance": 1e-6}, "tolerance"),
    ],
    ids=str,
)
def test_option_without_effect_warns_everywhere(
    shell: str, scene: Scene, solver: dict[str, object], option: str
) -> None:
    with pytest.warns(UserWarning, match=rf"solver.{option} has no effect") as caught:
        SHELLS[shell](scene.replace(solver=solver))
    assert len(caught) == 1


@pytest.mark.parametrize("shell", list(SHELLS))
@pytest.mark.parametrize(
    ("scene", "method"),
    [
        (LINEAR, "switched"),
        (TUNED, "switched"),
        (FRICTION, "exact"),
        (FRICTION, "rk4"),
        (FRICTION, "semi_implicit_euler"),
        (CUBIC, "exact"),
        (CUBIC, "switched"),
        (LINEAR.replace(**{"carriage.mass": 0.0}), "taylor"),
    ],
    ids=str,
)
def test_method_outside_its_domain_is_refused_everywhere(
    shell: str, scene: Scene, method: str
) -> None:
    with pytest.raises(CompileError, match=rf"solver.method: '{method}' does not apply .*allowed"):
        SHELLS[shell](scene.replace(**{"solver.method": method}))


@pytest.mark.parametrize("scene", [LINEAR, FRICTION, CUBIC, TUNED], ids=str)
def test_default_solver_warns_of_nothing(scene: Scene) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for shell in SHELLS.values():
            shell(scene)
