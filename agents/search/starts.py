"""The laws as which networks begin: exactly or nearly, as functions of the observation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.controller import columns
from agents.controllers.lqr import LQR
from agents.controllers.observed_state import ROWS
from agents.controllers.stretch_command import StretchCommand
from agents.search.forecast import force_memory
from mm_gym import DesignError, compile_scene
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.search.settings import LawName, SearchSettings
    from mm_gym import Scene

    Values = NDArray[np.float64]

FLOOR = 1e-3
"""Of a correlation unit's denominator, see `agents.policies.Policy`."""

STRETCH, PRICE = 0.125, 1.0
"""Where a clipped LQR is designed: fraction of the stretch's range, and price of its force."""

GAIN = 2.0
"""Of a switching function: the action is full as soon as it is beyond a half."""

MEMORY = 0.97
"""Of the estimate of a frequency: some 30 control steps."""


COARSE, FINE = 0.3, 0.01
"""Size of the changes of a switching function's weights, and of those of a frequency's estimate:
they are of order one, and a hundredth changes the frequency by as much as the springs can."""


@dataclass(frozen=True, eq=False)
class Start:
    """What a network is before hidden units take part.

    Attributes
    ----------
    pairs, units
        (r, 2, n + m), (r, 4): the correlation units of `agents.policies.Policy`.
    direct
        (k, 1 + n + m + r): bias and direct weights of each action.
    spreads
        (r,) size of the changes of each pair's weights.
    keep, enter
        (m, m), (m, n): the linear memory, which is not searched.
    """

    pairs: Values
    units: Values
    direct: Values
    spreads: Values
    keep: Values = field(default_factory=lambda: np.empty((0, 0)))
    enter: Values = field(default_factory=lambda: np.empty((0, 0)))


def start_of(scene: Scene, settings: SearchSettings, generator: np.random.Generator) -> Start:
    """Return the start that is asked for, with its further correlation units and its memory.

    Raises
    ------
    DesignError
        If the law does not apply to the scene. "auto" takes none then.
    """
    shown, law, extra = Shown(scene), settings.law, settings.extra
    if law == "auto":
        try:
            start = _law(scene, natural_law(scene), shown)
        except DesignError:
            start = _none(shown)
    else:
        start = _none(shown) if law == "none" else _law(scene, law, shown)
    keep, enter = _memory(scene, shown, settings.memory)
    pairs = np.pad(start.pairs, ((0, 0), (0, 0), (0, len(keep))))
    drawn = 0.5 * generator.standard_normal((extra, *pairs.shape[1:]))
    pairs = np.concatenate([pairs, drawn])
    units = np.concatenate([start.units, np.tile((0.0, FLOOR, 0.0, 1.0), (extra, 1))])
    spreads = np.concatenate([start.spreads, np.full(extra, COARSE)])
    direct = np.pad(start.direct, ((0, 0), (0, extra)))
    direct = np.insert(direct, [1 + shown.count] * len(keep), 0.0, axis=1)
    return Start(pairs, units, direct, spreads, keep, enter)


def natural_law(scene: Scene) -> LawName:
    """Return the law for a scene's actuators and excitation."""
    if scene.actuation.stretch is None:
        return "regulator"
    harmonic = {part.kind for part in scene.excitation} == {"harmonic"}
    return "tracking" if harmonic and scene.actuation.force is None else "switching"


class Shown:
    """What an observation (n,) shows.

    Attributes
    ----------
    count, frame
        Numbers of an observation, and of a frame of it; the newest frame is the last.
    state
        (4, n): the state x1, x2, v1, v2 [m, m/s] is nearest to `state` @ observation.
    actions
        Number of actuators.
    """

    def __init__(self, scene: Scene) -> None:
        plant = compile_scene(scene)
        self.channels = [channel.name for channel in plant.observed]
        self.frame, self.count = len(self.channels), len(self.channels) * plant.history
        self.units = np.array([1.0 / channel.factor for channel in plant.observed])
        self.zeros = np.array([channel.zero for channel in plant.observed])
        self.history, self.actions = plant.history, len(columns(scene))
        self.state = self.frame_state(0)

    def frame_state(self, age: int) -> Values:
        """Return `state` of the frame so many steps ago."""
        rows = np.zeros((self.frame, 4))
        for row, name in zip(rows, self.channels, strict=True):
            row[:] = ROWS.get(name, 0.0)
        inverse = np.linalg.pinv(rows) * self.units
        state = np.zeros((4, self.count))
        first = self.count - (age + 1) * self.frame
        state[:, first : first + self.frame] = inverse
        return state

    def stretch(self) -> Values | None:
        """Return (1 + n,) bias and weights of the stretch, or None if it is not shown."""
        if "stretch" not in self.channels:
            return None
        row, column = np.zeros(1 + self.count), self.channels.index("stretch")
        row[0], row[1 + self.count - self.frame + column] = self.zeros[column], self.units[column]
        return row


def _memory(scene: Scene, shown: Shown, states: int) -> tuple[Values, Values]:
    """Return the linear memory of a scene that has a random force and shows it."""
    random = {part.kind for part in scene.excitation} == {"noise"}
    if not (states and random and shown.history > 1):
        return np.empty((0, 0)), np.empty((0, 0))
    return force_memory(scene, _mean_force(scene, shown, 0), states)


def _none(shown: Shown) -> Start:
    direct = np.zeros((shown.actions, 1 + shown.count))
    return Start(np.empty((0, 2, shown.count)), np.empty((0, 4)), direct, np.empty(0))


def _law(scene: Scene, law: LawName, shown: Shown) -> Start:
    actuation = scene.actuation
    if law != "regulator" and actuation.stretch is None:
        msg = f"law: {law!r} tunes springs; actuation.stretch is missing"
        raise DesignError(msg)
    if law == "tracking":
        return _tracking(scene, shown)
    start = _switching(scene, shown) if actuation.stretch is not None else _none(shown)
    if actuation.force is not None:
        start.direct[0, 1 : 1 + shown.count] = _regulator(scene) @ shown.state
    elif law == "regulator":
        msg = "law: 'regulator' pushes; actuation.force is missing"
        raise DesignError(msg)
    return start


def _regulator(scene: Scene) -> Values:
    """Return the LQR's action as (4,) weights of the state, at the stretch of `_switching`."""
    stretch = None if scene.actuation.stretch is None else _design_stretch(scene)
    try:
        law = LQR(scene, stretch)
    except DesignError:
        law = LQR(scene.replace(**{"objective.stroke_weight": 0.0}), stretch)
    weights = np.zeros(4)
    weights[list(law.design.states)] = -law.design.gain[0] / law.limit
    return weights


def _design_stretch(scene: Scene) -> float:
    actuator = StretchCommand(scene).actuator
    return actuator.minimum + STRETCH * (actuator.maximum - actuator.minimum)


def _switching(scene: Scene, shown: Shown) -> Start:
    """Return the clipped LQR in the limit of a small price, as one switching function.

    The springs soften where the wanted internal force F and the offset have unlike signs, and
    stiffen elsewhere.
    """
    law = ClippedLQR(scene, _design_stretch(scene), PRICE)
    ahead = law.lead.transitions[len(law.lead.transitions) // 2] @ shown.state
    pair = np.stack([law.gain @ ahead, ahead[1] - ahead[0]])
    pair /= np.linalg.norm(pair, axis=1, keepdims=True)
    direct = np.zeros((shown.actions, 2 + shown.count))
    direct[-1, -1] = GAIN
    return Start(pair[None], np.array([[0.0, FLOOR, 0.0, 1.0]]), direct, np.array([COARSE]))


def _tracking(scene: Scene, shown: Shown) -> Start:
    """Return the absorber that is tuned to the frequency of the force, found by its correlation.

    The mean force of each control step follows from two frames: it changes the momentum, and
    balances damper and carriage spring, whatever the sphere's springs do. Of a harmonic force, the
    cosine of the phase between two steps is a correlation unit; the stretch that matches is nearly
    linear in it.
    """
    if shown.history < 3:  # noqa: PLR2004 - two forces
        msg = f"sensors.history: got {shown.history}; allowed for tracking: at least 3"
        raise DesignError(msg)
    step, command = scene.control.time_step, StretchCommand(scene)
    pair = np.stack([_mean_force(scene, shown, age) for age in (0, 1)])
    pair /= np.abs(pair).max()
    low, high = command.actuator.minimum, command.actuator.maximum
    ends = spring_stiffness([high, low], scene.springs.stiffness)
    frequencies = np.linspace(*np.sqrt(ends / scene.sphere.mass), 33)
    cosines = np.cos(frequencies * step)
    wanted = stretch_for_stiffness(scene.sphere.mass * frequencies**2, scene.springs.stiffness)
    middle, scale = cosines.mean(), 1.0 / cosines.std()
    slope, level = np.polyfit((cosines - middle) * scale, wanted, 1)
    direct = np.zeros((1, 2 + shown.count))
    if command.actuator.command == "position":
        half = 0.5 * (high - low)
        direct[0, [0, -1]] = (level - 0.5 * (high + low)) / half, slope / half
    else:
        present = shown.stretch()
        if present is None or command.actuator.rate_limit is None:
            msg = "sensors.channels: tracking needs the stretch, whose rate is commanded"
            raise DesignError(msg)
        direct[0, :-1] = -present
        direct[0, 0] += level
        direct[0, -1] = slope
        direct /= command.actuator.rate_limit * step
    units = np.array([[MEMORY, FLOOR, middle, scale]])
    return Start(pair[None], units, direct, np.array([FINE]))


def _mean_force(scene: Scene, shown: Shown, age: int) -> Values:
    """Return (n,) weights of the mean force on the carriage [N] in a control step.

    The integral of the spring's force is that of Hermite's cubic, of error (step w)^4 / 720.
    """
    x1, _, v1, v2 = shown.frame_state(age)
    past = shown.frame_state(age + 1)
    step, carriage = scene.control.time_step, scene.carriage
    momentum = carriage.mass * (v1 - past[2]) + scene.sphere.mass * (v2 - past[3])
    displacement = 0.5 * (x1 + past[0]) - step / 12.0 * (v1 - past[2])
    stiffness = carriage.stiffness * carriage.linear_coefficient
    return (momentum + carriage.damping * (x1 - past[0])) / step + stiffness * displacement
