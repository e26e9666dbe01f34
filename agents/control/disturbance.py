"""What disturbs the model: its covariance, measured, and the force or the motion behind it."""

import numpy as np
from numpy.typing import NDArray

from agents.control.actuators import Actuators
from agents.control.controller import Memory
from agents.control.model import Innovation
from agents.control.scene import ENDLESS, drawn_but, plant_of
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

LANES, STEPS, SEED = 64, 200, 3_000_000
"""Episodes and control steps that are simulated, apart from those of any evaluation."""

LEAST = 1e-5  # least standard deviation of a state's disturbance in a step over its scale [-]
ORDER = 8  # past forces from which the next is predicted


def deviations(scene: Scene) -> Array:
    """Return by how much states differ from the model's prediction after a control step.

    They are (steps, lanes, 4), of simulated episodes with zero action.
    """
    drawn = drawn_but(scene, "sensors.")
    scene = scene.replace(sensors={}, randomization=drawn, **ENDLESS)
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
    _, info = env.reset(seed=SEED)
    innovation, actuators = Innovation(scene), Actuators(scene)
    applied = asked = info["applied"]
    _, _, memory = innovation.missed(innovation.begin(LANES), info["state"], applied)
    action = np.zeros(env.action_space.shape)
    differences = np.empty((min(STEPS, scene.control.steps), LANES, 4))
    for step in range(len(differences)):
        applied, asked = actuators.reached(action, applied, asked)
        *_, info = env.step(action)
        differences[step], _, memory = innovation.missed(memory, info["state"], applied)
    return differences


def covariance(scene: Scene) -> Array:
    """Return the covariance (4, 4) of what a control step adds to the model's prediction."""
    flat = deviations(scene).reshape(-1, 4)
    return flat.T @ flat / len(flat) + np.diag((LEAST * state_scales(scene)) ** 2)


def state_scales(scene: Scene) -> Array:
    """Return the sizes (4,) of x1, x2 [m], v1, v2 [m/s] by which they are of order one."""
    objective = scene.objective
    displacement, velocity = objective.displacement_scale, objective.velocity_scale
    return np.array([displacement, displacement, velocity, velocity])


def prediction_weights(scene: Scene) -> Array:
    """Return the weights (ORDER,) of the last forces, newest first, in the prediction of the next.

    They are fitted by least squares to simulated episodes; see `ForceObserver`.
    """
    forces = force_of(force_column(scene), deviations(scene))
    past = np.stack(
        [forces[ORDER - 1 - i : len(forces) - 1 - i].ravel() for i in range(ORDER)], axis=1
    )
    return np.linalg.lstsq(past, forces[ORDER:].ravel(), rcond=None)[0]


def force_column(scene: Scene) -> Array:
    """Return the state (4,) that a force of 1 N on the carriage leads to in a control step."""
    if scene.actuation.is_between:
        scene = scene.replace(**{"actuation.force.between": "ground"})
    return plant_of(scene).discrete()[1][:, 0]


def force_of(column: Array, deviation: Array) -> Array:
    """Return the constant force on the carriage [N] that explains a deviation (..., 4) best."""
    return deviation @ column / (column @ column)


class ForceObserver:
    """The disturbing force of the last control step, from how the state differs from the model's.

    Ohnishi, Shibata and Murakami, *Motion control for advanced mechatronics*, IEEE/ASME Trans.
    Mechatron. 1 (1996), section III.
    """

    def __init__(self, scene: Scene) -> None:
        self.innovation, self.column = Innovation(scene), force_column(scene)
        self.begin = self.innovation.begin

    def force(
        self, memory: Memory, state: Array, applied: Array
    ) -> tuple[Array, NDArray[np.bool_], Memory]:
        """Return the forces (lanes,) [N] of the step that led to the state.

        Also which are known, all but at an episode's start, where it is 0; and the memory.
        """
        missed, known, memory = self.innovation.missed(memory, state, applied)
        return force_of(self.column, missed), known, memory
