"""The scene without what a controller cannot know, for predictions, and what disturbs it."""

from functools import lru_cache
from typing import cast

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from agents.control.actuators import Actuators
from agents.control.controller import Memory, chosen
from agents.control.scene import ENDLESS, PARTS, drawn_but, nominal, plant_of
from mm_gym import DesignError, MovingMassVectorEnv, Plant, Scene
from mm_gym.arrays import Array

AMPLE = 1e3
"""Force limit of the model over all that is known to push: a disturbance enters as a force."""

TUNES = "stretch", "damping"  # actuators that change the plant

TERMS, ROUND_OFF = 48, 1e-15  # of a series, and of its largest coefficients

AMPLITUDE = "excitation.0.amplitude"
HELD = {"kind": "harmonic", "amplitude": 0.0, "frequency": 0.0, "phase": 0.5 * np.pi}
"""A force on the carriage that is held, and its field."""


class Model:
    """Motion of the carriage and the sphere from a given state, step by step.

    There is no excitation, no noise and no delay; randomised parameters are at the middle of their
    ranges, and the actuators reach at once what is applied. A known disturbance enters as a
    force on the carriage that is constant over a control step: in the control force, or, where that
    acts between the masses, as a harmonic force of frequency 0.

    Nothing shows an interface's own states (`Interface.states`), such as z of Bouc and Wen. They
    begin at 0, as an episode does, and are then what the steps of the model make of them.

    It keeps nothing from one `begin` to the next.

    Attributes
    ----------
    own
        (lanes, n) the interface's own states after the last step; n is 0 if it has none.
    """

    def __init__(self, scene: Scene) -> None:
        force = scene.actuation.force
        unit = scene.carriage.stiffness * scene.objective.displacement_scale
        self.limit = AMPLE * max(unit, 1.0 if force is None else force.limit)
        self.has_force = force is not None
        self.is_between = scene.actuation.is_between
        pushed = {"limit": self.limit, "between": "masses" if self.is_between else "ground"}
        drawn = [name for name in scene.randomization if name.startswith(PARTS)]
        changes: dict[str, object] = {
            **{name: nominal(scene, name) for name in drawn},
            "excitation": [HELD] if self.is_between else [],
            "randomization": {AMPLITUDE: [-self.limit, self.limit]} if self.is_between else {},
            "initial": {},
            "sensors": {},
            "objective.effort_weight": 0.0,
            **ENDLESS,
            "control.steps": 10**9,  # the most that a scene allows
        }
        tuned = {
            name: {"minimum": actuator.minimum, "maximum": actuator.maximum, "lag": 0.0}
            for name, actuator in scene.actuation
            if actuator is not None and name != "force"
        }
        actuators, first = Actuators(scene), int(self.has_force)  # after the force
        self.middle, self.half = actuators.middle[first:], actuators.half[first:]
        if (damper := scene.actuation.damping) is not None:
            tuned["damping"]["of"] = damper.of
        changes["actuation"] = {"force": pushed, **tuned}
        self.effort_weight = 0.0 if scene.own_reward else scene.objective.effort_weight
        self.scene = scene.replace(**changes)
        self.own_rows = plant_of(self.scene).support.own_rows
        self.envs: dict[int, MovingMassVectorEnv] = {}

    def at_rest(self, lanes: int) -> Array:
        """Return the interface's own states (lanes, n) with which an episode begins."""
        return np.zeros((lanes, len(self.own_rows)))

    def begin(self, state: Array, own: Array | None = None) -> None:
        """Begin with states (lanes, 4): x1, x2 [m], v1, v2 [m/s], and the interface's own ones.

        Those are (lanes, n), by default as an episode begins.
        """
        lanes = len(state)
        if lanes not in self.envs:
            made = MovingMassVectorEnv(self.scene, lanes, autoreset_mode="Disabled", copy=False)
            made.reset(seed=0)
            self.envs[lanes] = made
        self.env, self.state = self.envs[lanes], state
        self.own = self.at_rest(lanes) if own is None else own
        if not self.is_between:  # else each step begins anew
            self._reset({})

    def _reset(self, fields: dict[str, Array]) -> None:
        x1, x2, v1, v2 = np.ascontiguousarray(self.state.T)
        self.env.reset(
            options={
                "initial.carriage_displacement": x1,
                "initial.sphere_offset": x2 - x1,
                "initial.carriage_velocity": v1,
                "initial.sphere_velocity": v2,
                **fields,
            }
        )
        if self.own_rows:
            begun = self.env.get_state()
            cast("Array", begun["values"])[self.own_rows] = self.own.T
            self.env.set_state(begun)

    def advance(self, applied: Array, disturbance: Array | float = 0.0) -> tuple[Array, Array]:
        """Make a control step; return the states (lanes, 4) and rewards (lanes,) after it.

        Parameters
        ----------
        applied
            (lanes, k): force [N], stretch [-] and damping [N s/m] during the step. The cost of
            actions is not in the rewards.
        disturbance
            (lanes,) a known force on the carriage [N], held over the step.
        """
        force = applied[:, 0] if self.has_force else 0.0
        if self.is_between:
            self._reset({AMPLITUDE: np.broadcast_to(disturbance, len(applied))})
        else:
            force = disturbance + force
        actions = np.empty((len(applied), 1 + len(self.middle)))
        actions[:, 0] = force / self.limit
        actions[:, 1:] = (applied[:, int(self.has_force) :] - self.middle) / self.half
        _, rewards, *_, info = self.env.step(actions)
        self.state = info["state"].copy() if self.is_between else info["state"]
        if self.own_rows:
            self.own = cast("Array", self.env.get_state()["values"])[self.own_rows].T
        return info["state"], rewards


class LinearModel:
    """A `Model` of a linear plant, by arithmetic alone, so that exports can follow it.

    The transition over a step is a Chebyshev series in the stretch or damping that is tuned. Raise
    `DesignError` if the plant is not linear, more than one actuator tunes it, or the series is
    long.
    """

    def __init__(self, scene: Scene) -> None:
        plant, actuators = plant_of(Model(scene).scene), Actuators(scene)
        names = scene.actuation.names
        self.forces = [k for k, name in enumerate(names) if name == "force"]
        self.tuned = [k for k, name in enumerate(names) if name in TUNES]
        if plant.kind not in {"linear", "parametric linear"} or len(self.tuned) > 1:
            msg = f"model: got a {plant.kind} plant of {', '.join(names)}; allowed: a linear one"
            raise DesignError(msg)
        field, self.middle, self.half = "", 0.0, 0.0
        for k in self.tuned:
            fields = {"stretch": "initial.stretch", "damping": str(scene.actuation.damped)}
            field = fields[names[k]]
            self.middle, self.half = float(actuators.middle[k]), float(actuators.half[k])
        self.series = _series(plant, len(self.forces), field, self.middle, self.half)
        self.own_rows = ()

    def at_rest(self, lanes: int) -> Array:
        """Return no states of an interface (lanes, 0)."""
        return np.zeros((lanes, 0))

    def begin(self, state: Array, own: Array) -> None:
        """Begin with states (lanes, 4)."""
        self.state, self.own = state, own

    def advance(self, applied: Array) -> tuple[Array, None]:
        """Return the states (lanes, 4) after a control step, and no rewards."""
        known = np.concatenate([self.state, applied[:, self.forces]], 1)
        if not self.tuned:
            self.state = known @ self.series[0].T
            return self.state, None
        at = (applied[:, self.tuned[0]] - self.middle) / self.half
        terms = [np.ones_like(at), at]
        while len(terms) < len(self.series):
            terms.append(2.0 * at * terms[-1] - terms[-2])
        rows = np.column_stack(terms) @ self.series.reshape(len(terms), -1)
        matrices = rows.reshape(-1, *self.series.shape[1:])
        self.state = np.einsum("nij,nj->ni", matrices, known)
        return self.state, None


@lru_cache(maxsize=64)  # every design of a search asks for that of the same scene
def _series(plant: Plant, forces: int, field: str, middle: float, half: float) -> Array:
    """Return the transition and what a force adds, as a series (terms, 4, 4 + forces) in a field.

    Without a field it is a single term. Raise `DesignError` if it does not end.
    """
    nodes = chebyshev.chebpts1(TERMS)
    values = middle + half * nodes
    points = [{field: float(value)} for value in values] if field else [None]
    inputs = ["force"] * forces
    sampled = [plant.state_space(inputs, [], sampled=True, at=at) for at in points]
    both = np.stack([np.hstack([one.A[:4, :4], one.B[:4]]) for one in sampled])
    if not field:
        return both
    basis = chebyshev.chebvander(nodes, TERMS - 1)
    both = np.linalg.solve(basis, both.reshape(TERMS, -1)).reshape(both.shape)
    matter = np.abs(both) > ROUND_OFF * np.abs(both).max(axis=0)
    last = matter.any(axis=(1, 2)).nonzero()[0][-1]
    if last == TERMS - 1:
        msg = f"model: {field}: too wide a range for a series"
        raise DesignError(msg)
    return both[: last + 1]


def model_of(scene: Scene) -> Model | LinearModel:
    """Return the linear model of a scene where there is one: it makes no rewards."""
    try:
        return LinearModel(scene)
    except DesignError:
        return Model(scene)


class Innovation:
    """By how much the motion differs from what the model predicts for the last control step."""

    def __init__(self, scene: Scene) -> None:
        self.model = model_of(scene)

    def begin(self, lanes: int) -> Memory:
        return {
            "begun": np.zeros(lanes, np.bool_),
            "last": np.zeros((lanes, 4)),
            "own": self.model.at_rest(lanes),
        }

    def missed(
        self, memory: Memory, state: Array, applied: Array
    ) -> tuple[Array, NDArray[np.bool_], Memory]:
        """Return what the model missed (lanes, 4), which lanes have a last step, and the memory.

        Arguments are those of `Law.action`.
        """
        begun, last, own = memory["begun"], memory["last"], memory["own"]
        missed = np.zeros_like(last)
        if begun.any():
            self.model.begin(last, own)
            missed = chosen(begun, state - self.model.advance(applied)[0], missed)
            own = chosen(begun, self.model.own, own)
        return missed, begun, {"begun": np.ones_like(begun), "last": state.copy(), "own": own}


def require_reward_of_motion(scene: Scene) -> None:
    """Raise `DesignError` if the reward reads what a disturbance is, not what it does.

    Rewards of a `Model` know only the force on the carriage that is equivalent to it.
    """
    hidden = ["applied_force", "disturbance_force", "ground_acceleration"]
    if any(part.target == "ground" for part in scene.excitation):
        hidden.append("carriage_acceleration")
        if scene.own_reward is None and scene.objective.carriage_acceleration_weight > 0.0:
            msg = (
                "objective.carriage_acceleration_weight: allowed for predictive control under "
                "ground motion: 0; its model replaces the ground motion by a force on the carriage"
            )
            raise DesignError(msg)
    if scene.own_reward is None or not scene.excitation:
        return
    for name in scene.own_reward.arguments:
        if name in hidden:
            msg = (
                f"reward: {scene.own_reward.name} reads {name}; the model of predictive control "
                f"replaces the excitation by a force on the carriage; allowed: all but "
                f"{', '.join(hidden)}"
            )
            raise DesignError(msg)


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
