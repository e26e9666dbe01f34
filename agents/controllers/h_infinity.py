"""The H-infinity controller: the least amplification at the worst frequency."""

from dataclasses import dataclass
from importlib import import_module
from typing import NamedTuple

import control
import numpy as np
from gymnasium.error import DependencyNotInstalled
from scipy.linalg import schur, solve_discrete_are

from agents.control.actuators import Command
from agents.control.controller import Acted, Controller, Info, Memory, Observation
from agents.control.kalman_filter import hidden_mode, require_detectable, solvable, told_by
from agents.control.observed_actuators import Frame
from agents.control.scene import STATES, force_weight, nominal, plant_of
from agents.controllers.lqg import best_detuned, with_effort, without_force
from agents.controllers.lqr import state_weight
from agents.controllers.registry import Entry, regulator_entry
from mm_gym import DesignError, LinearSystem, MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

NOISE = 0.3
"""Size of the sensors' noise over each channel's scale: it is weighed against the disturbance."""

NOISES = 0.03, 0.3, 3.0
"""Those that are tried: with less noise a controller is quicker, and does more for what it sees."""

ABOVE = 0.005  # how far the bound is above the least one, at which the equations are singular

EXACTNESS = 1e-5
"""How exactly the least bound is found: with less, the rounding of a machine would choose it."""

GROWTH = 1.0 + 1e-6  # of a controller's mode in a step, above which it is unstable

DOUBLINGS = 30  # of the bound, until one is kept


class Matrices(NamedTuple):
    """A linear system A, B, C, D: of one control step, or after `bilinear` of continuous time."""

    A: Array
    B: Array
    C: Array
    D: Array


@dataclass(frozen=True, eq=False)
class HInfinityDesign:
    """A controller of sampled measurements, and the closed loop from disturbances to costs."""

    system: LinearSystem  # the sampled plant, reduced to what force and disturbance reach
    # From (disturbance, noise, force) to (costs, measurements), all of order one.
    generalised: Matrices
    # From measurements to the force, both of order one; it works at every control step.
    controller: Matrices
    closed: Matrices  # from disturbance and noise to costs
    # Of its largest singular value over all frequencies: `ABOVE` over the least that any linear
    # controller has.
    bound: float


def design_h_infinity(scene: Scene, noise: float = NOISE) -> HInfinityDesign:
    """Design the controller of the sampled plant, with lag and delay among its states.

    The costs are the terms of the scene's reward, of which each has the root of its weight. The
    disturbance is a force of the actuator's limit, or the ground acceleration that has its effect
    if all of the scene's excitation moves the ground; in addition each sensor has noise, over its
    channel's scale. Measured are the channels of the carriage. Raise `DesignError` if there is no
    force, it is commanded by its rate or costs nothing, nothing of the carriage is observed, or no
    controller exists: the force does not stabilise what the cost shows, or the sensors do not show
    it; `gymnasium.error.DependencyNotInstalled` without Slycot (extra: robust).

    Notes
    -----
    Doyle, Glover, Khargonekar and Francis, *State-space solutions to standard H2 and H-infinity
    control problems*, IEEE Trans. Autom. Control 34 (1989). `control.hinfsyn` finds the least
    bound, and its routine, SLICOT's SB10AD, the controller above that. The bilinear map takes a
    control step to continuous time and back, and keeps the amplification.
    """
    force_weight(scene)
    system, measured = _plant(scene)
    generalised = _generalised(scene, system, measured, noise)
    count = len(measured)
    require_detectable(generalised.A, generalised.C[-count:])
    unreached = hidden_mode(generalised.A.T, generalised.B[:, -1:].T)
    if unreached is not None:
        msg = f"the force does not reach the mode {unreached:.6g}, which does not decay"
        raise DesignError(msg)
    controller, closed, bound = _least(bilinear(generalised), count)
    return HInfinityDesign(
        system, generalised, bilinear(controller, -1.0), bilinear(closed, -1.0), bound
    )


def _least(plant: Matrices, count: int) -> tuple[Matrices, Matrices, float]:
    """Return controller, closed loop and bound, of so many measurements in continuous time.

    The routine lowers its bound for as long as the closed loop is stable, which is sometimes longer
    than it keeps the bound; from there the bound is doubled until it is kept, and then bisected.
    """
    try:
        *_, found, _ = control.hinfsyn(control.StateSpace(*plant), count, 1)
    except control.ControlSlycot as error:
        msg = "H-infinity needs Slycot; install the extra `robust`"
        raise DependencyNotInstalled(msg) from error
    except ArithmeticError as error:
        msg = f"no H-infinity controller exists: {' '.join(str(error).split())}"
        raise DesignError(msg) from error
    low = float(found)
    solutions = (_solution(plant, count, low * 2.0**k) for k in range(1, DOUBLINGS))
    best = next((solution for solution in solutions if solution is not None), None)
    if best is None:
        msg = f"no H-infinity controller attains a bound; tried up to {low * 2.0**DOUBLINGS:.2g}"
        raise DesignError(msg)
    low = max(low, 0.5 * best[-1])
    while best[-1] > low * (1.0 + EXACTNESS):
        middle = float(np.sqrt(low * best[-1]))
        better = _solution(plant, count, middle)
        low, best = (middle, best) if better is None else (low, better)
    return _solution(plant, count, best[-1] * (1.0 + ABOVE)) or best


def _solution(plant: Matrices, count: int, bound: float) -> tuple[Matrices, Matrices, float] | None:
    """Return controller, closed loop and bound; None if the bound is not kept."""
    sizes = len(plant.A), plant.B.shape[1], len(plant.C), 1, count
    try:
        solution = import_module("slycot").sb10ad(*sizes, bound, *plant, job=4)
    except ArithmeticError:  # not yet admissible
        return None
    closed = Matrices(*solution[5:9])
    if control.linfnorm(control.StateSpace(*closed))[0] > bound:
        return None
    return Matrices(*solution[1:5]), closed, bound


def bilinear(step: Matrices, sign: float = 1.0) -> Matrices:
    """Return the continuous system with z = (1 + s) / (1 - s); the unit circle is its axis.

    With the sign -1 it is the inverse.
    """
    one = np.eye(len(step.A))
    inverse = np.linalg.inv(one + sign * step.A)
    root = np.sqrt(2.0)
    return Matrices(
        (step.A - sign * one) @ inverse,
        root * inverse @ step.B,
        root * step.C @ inverse,
        step.D - sign * (step.C @ inverse @ step.B),
    )


def _plant(scene: Scene) -> tuple[LinearSystem, list[str]]:
    """Return the sampled plant from force and disturbance, and the names of what is measured."""
    plant = plant_of(scene)
    measured = [name for name in plant.channels if name.startswith("carriage_")]
    if not measured:
        names = ", ".join(plant.channels)
        msg = f"sensors.channels: got {names}; allowed for H-infinity: at least one of the carriage"
        raise DesignError(msg)
    is_ground = {part.target for part in scene.excitation} == {"ground"}
    inputs = ["force", "ground" if is_ground else "disturbance"]
    return plant.state_space(inputs, [*STATES, *measured], sampled=True).controllable(), measured


def _generalised(scene: Scene, system: LinearSystem, measured: list[str], least: float) -> Matrices:
    """Return the system from (disturbance, noise, force) to (costs, measurements)."""
    weight = np.sqrt(force_weight(scene))
    limit, count, size = Command(scene, "force").high, len(measured), len(system.A)
    is_ground = system.inputs[1].name == "ground"
    disturbed = limit / (nominal(scene, "carriage.mass") if is_ground else 1.0)
    scales, noise = (frame := Frame(scene, measured)).unit, frame.noise
    noise = np.hypot(least, noise / scales)
    weights, axes = np.linalg.eigh(state_weight(scene))
    kept = weights > 0.0
    costs = np.sqrt(weights[kept])[:, None] * axes[:, kept].T @ system.C[:4]
    seen, direct = system.C[4:] / scales[:, None], system.D[4:] / scales[:, None]
    b = np.hstack([disturbed * system.B[:, 1:], np.zeros((size, count)), limit * system.B[:, :1]])
    d = np.zeros((len(costs) + 1 + count, count + 2))
    d[len(costs), -1] = weight * limit
    d[-count:] = np.hstack([disturbed * direct[:, 1:], np.diag(noise), limit * direct[:, :1]])
    c = np.vstack([costs, np.zeros((1, size)), seen])
    # Without those that matter to neither, as a sphere that nothing couples to the carriage: ground
    # motion moves it relative to the ground.
    matters = told_by(system.A, (c != 0.0).any(axis=0))
    a, b, c = system.A[np.ix_(matters, matters)], b[matters], c[:, matters]
    largest = np.abs(c).max(axis=0)
    unit = 1.0 / np.where(largest > 0.0, largest, 1.0)  # states of order one, too
    return Matrices(a * unit / unit[:, None], b / unit[:, None], c * unit, d)


def correction(k: Matrices) -> Array:
    """Return by how much a limit that changes the output by 1 is to change the state (n, outputs).

    An unstable controller whose output is clipped otherwise runs away. Of all gains that make its
    clipped motion decay this one is of the least output, and it acts on what grows alone: a stable
    controller is not changed. Kothare, Campo, Morari and Nett, *A unified framework for the study
    of anti-windup designs*, Automatica 30 (1994).
    """
    triangle, axes, count = schur(k.A, sort=lambda re, im=0.0: np.hypot(re, im) > GROWTH)
    growing, shown = triangle[:count, :count], k.C @ axes[:, :count]
    if count == 0:
        return np.zeros(k.C.T.shape)
    one = np.eye(len(shown))
    with solvable("the correction of an unstable H-infinity controller"):
        p = solve_discrete_are(growing.T, shown.T, np.zeros_like(growing), one)
    gain = np.linalg.solve(one + shown @ p @ shown.T, shown @ p @ growing.T).T
    return axes[:, :count] @ gain


class HInfinity(Controller):
    """Run the controller on what is observed, and tell it what the force's limit takes off.

    The worst frequency and the largest force are not what a scene disturbs and scores.

    Parameters
    ----------
    effort
        Factor of the force's weight in the reward.
    noise
        Size of the sensors' noise over each channel's scale.
    """

    name = "H-infinity"

    def __init__(self, scene: Scene, effort: float = 1.0, noise: float = NOISE) -> None:
        self.effort, self.noise = effort, noise
        self.design = design_h_infinity(with_effort(scene, effort), noise)
        self.correction = correction(self.design.controller)
        self.frame = Frame(scene, [signal.name for signal in self.design.system.outputs[4:]])

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        return {"state": np.zeros((env.num_envs, len(self.design.controller.A)))}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        k, state = self.design.controller, memory["state"]
        seen = self.frame.numbers(observation)  # over the channels' scales
        wanted = state @ k.C.T + seen @ k.D.T
        action = np.clip(wanted, -1.0, 1.0)
        state = state @ k.A.T + seen @ k.B.T + (action - wanted) @ self.correction.T
        return action, {"state": state}


def best_detuned_h_infinity(scene: Scene) -> HInfinity:
    """Search a factor of the force's weight over five decades, for each size of the noise."""
    found = best_detuned(scene, HInfinity, NOISES)
    found.name = f"H-infinity, effort weight times {found.effort:.2g}, noise {found.noise:.2g}"
    return found


ENTRIES = (
    regulator_entry("h-infinity", ("force",), HInfinity, 53, "further", label=HInfinity.name),
    Entry(
        "detuned-h-infinity",
        ("force",),
        best_detuned_h_infinity,
        53,
        "further",
        "detuned H-infinity",
        without_force,
    ),
)
