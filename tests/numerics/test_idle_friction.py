"""Is friction that is left out, because no motion of the scene slips, never missed?"""

import numpy as np
import pytest

from mm_gym import Scene, SceneError, compile_scene, simulate
from mm_gym.simulation.lanes import Lanes

SLOW = Scene(
    interface={
        "kind": "dry_friction",
        "static_coefficient": 0.5,
        "kinetic_coefficient": 0.25,
        "reference_velocity": 2.0,
        "normal_force": 0.4,
    },
    initial={"carriage_displacement": [-0.01, 0.01], "sphere_velocity": [-0.1, 0.1]},
    control={"time_step": 0.01, "steps": 60},
)
WELLS = SLOW.replace(
    **{"carriage.linear_coefficient": -1.0, "carriage.cubic_coefficient": 1e4},
)
DRAWN = SLOW.replace(
    springs={"kind": "small_on_large"},
    randomization={
        "sphere.mass": [0.02, 0.08],
        "carriage.mass": [0.05, 0.2],
        "springs.stretch": [1.0, 3.0],
    },
)
SCENES = {"linear": SLOW, "wells": WELLS, "drawn": DRAWN}
SLIPS = [0.0, 0.0, 0.0, 2.5]
MAY_SLIP = [0.08, 0.08, 0.0, 0.0]
"""A state in stick with the energy to slip later: 2 m/s of m1 m2 / (m1 + m2) are 0.057 J."""

REMEDY = r"interface\.reference_velocity = 2 m/s.*solver\.method = 'switched'"


@pytest.mark.parametrize("scene", SCENES.values(), ids=list(SCENES))
@pytest.mark.parametrize("state", [SLIPS, MAY_SLIP])
def test_jacobian_of_a_state_that_may_slip_is_refused(scene, state):
    plant = compile_scene(scene)
    assert not plant.support.slips
    assert "never slips" in plant.explain()
    with pytest.raises(SceneError, match=f"state: got .*{REMEDY}"):
        plant.jacobian(state, [])
    with pytest.raises(SceneError, match=f"state: got .*{REMEDY}"):
        plant.jacobian([[0.0, 0.0, 0.0, 0.1], state], [])
    plant.jacobian([0.0, 0.0, 0.0, 0.1], [])


def test_remedy_of_the_message_gives_the_motion_in_slip():
    jacobian = compile_scene(SLOW.replace(**{"solver.method": "switched"})).jacobian(SLIPS, [])
    start = {"carriage_displacement": 0.0, "sphere_velocity": SLIPS[3]}
    motion = simulate(SLOW.replace(initial=start), duration=0.01)
    np.testing.assert_allclose(jacobian.end, motion.state[-1], rtol=0.0, atol=1e-12)


def test_linear_system_about_a_point_in_slip_is_refused():
    plant = compile_scene(SLOW)
    with pytest.raises(SceneError, match=f"about: got a slip velocity of 2.5 m/s.*{REMEDY}"):
        plant.state_space(["disturbance"], ["x1"], about=SLIPS)
    plant.state_space(["disturbance"], ["x1"], about=[0.0, 0.0, 0.5, 0.0])


def test_friction_that_is_left_out_keeps_its_stated_values():
    lanes = Lanes(compile_scene(SLOW), 3)
    lanes.seed(0)
    lanes.restart()
    for name, value in SLOW.interface:
        if name != "kind":
            assert np.array_equal(lanes.drawn(f"interface.{name}"), [value] * 3), name


@pytest.mark.parametrize("scene", SCENES.values(), ids=list(SCENES))
def test_every_state_of_the_scenes_own_motions_is_accepted(scene):
    plant = compile_scene(scene)
    lanes = Lanes(plant, 20)
    lanes.seed(0)
    lanes.restart()
    for _ in range(scene.control.steps):
        snapshot = lanes.snapshot()
        plant.jacobian(None, [], at=snapshot)
        lanes.advance(np.zeros(0, np.float32))
    snapshot["values"][:4, 7] = SLIPS
    with pytest.raises(SceneError, match=f"at: got .*{REMEDY}"):
        plant.jacobian(None, [], at=snapshot)


def test_jacobian_at_parameters_that_the_plant_was_not_compiled_for_is_refused():
    plant = compile_scene(SLOW)
    lane = simulate(plant, duration=0.01).parameters
    other = simulate(SLOW.replace(**{"sphere.mass": 0.05}), duration=0.01).parameters
    plant.jacobian([0.0, 0.0, 0.0, 0.1], [], at=lane)
    for call in (
        lambda at: plant.jacobian([0.0, 0.0, 0.0, 0.1], [], at=at),
        lambda at: plant.state_space(["disturbance"], ["x1"], at=at),
        lambda at: plant.jacobian(
            None, [], at={"values": at[:, None], "streams": np.zeros((2, 1))}
        ),
    ):
        with pytest.raises(
            SceneError, match=r"at: sphere\.mass: got 0\.05; allowed: 0\.04 to 0\.04"
        ):
            call(other)
