"""A caller's own reward: minus a cost of channels, in place of the scene's objective."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cached_property
from typing import Any, Self, TypeAlias

import numba
import numpy as np
from numba import types
from pydantic import PrivateAttr

from mm_gym.arrays import Array
from mm_gym.compiler.jit import COMPILED
from mm_gym.errors import SceneError, refuse, suggest
from mm_gym.lanes import layout
from mm_gym.lanes.memory import rows_of
from mm_gym.plant.task import scales
from mm_gym.scene.mechanics import WITHOUT_STRETCH
from mm_gym.scene.scene import Scene, bounds, require_scene
from mm_gym.step.channels import CHANNELS
from mm_gym.step.own_reward import rewarding
from mm_gym.user_code import load

RewardLike: TypeAlias = "str | Callable[..., float] | OwnReward"
"""A function of channels, FILE.py:NAME of one, or what was made of one."""

PROBES = 256  # states at which a cost is tried before the first step
STAGE = "Failed in"  # how a first line of numba begins that has no reason in it
BEYOND = 1.1  # of a limit that ends an episode: the step that ends it goes further


class OwnReward:
    """A function of channels, the cost of a control step; the reward is minus the cost.

    Parameters
    ----------
    reward
        A function, or FILE.py:NAME of one, whose file is executed. Its arguments are named after
        channels (docs/excitation.md). Each is a number in the channel's SI unit at the end of the
        step, without the noise and delay of the sensors. The function returns a number; numba
        compiles it.

    Attributes
    ----------
    given
        The parameter `reward`.
    name
        Name of the function, for messages.
    arguments
        The channels that it reads, in order.

    Raises
    ------
    SceneError
        If the file or the function is wrong, an argument is not a channel, numba cannot compile the
        function, or it returns anything but a number.
    """

    def __init__(self, reward: str | Callable[..., float]) -> None:
        self.given = reward
        function = load(reward, "reward") if isinstance(reward, str) else reward
        if not callable(function):
            refuse("reward", f"{reward!r}", "a function of channels, or FILE.py:NAME of one")
        self.name = (
            reward if isinstance(reward, str) else getattr(function, "__name__", str(reward))
        )
        self._function = getattr(function, "py_func", function)
        self.arguments = self._arguments()
        self._cost = self._compiled(function)

    def _arguments(self) -> tuple[str, ...]:
        try:
            parameters = inspect.signature(self._function).parameters.values()
        except (TypeError, ValueError) as error:
            msg = f"reward: {self.name}: its arguments cannot be read: {error}"
            raise SceneError(msg) from None
        several = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
        names = tuple(str(one) if one.kind in several else one.name for one in parameters)
        for name in names or ("",):
            if name not in CHANNELS:
                refuse(
                    f"reward: {self.name}",
                    f"the argument {name!r}{suggest(name, CHANNELS)}",
                    ", ".join(CHANNELS),
                )
        return names

    def _compiled(self, function: Any) -> Any:  # noqa: ANN401 - numba's dispatcher
        """Compile the function for numbers, and check what it returns."""
        if not COMPILED:
            return self._function
        kinds = (types.float64,) * len(self.arguments)
        try:
            if not hasattr(function, "overloads"):  # numba takes functions, not all callables
                function = numba.njit(nogil=True, error_model="numpy")(function)
            function.compile(kinds)
        except Exception as error:
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            reason = next((line for line in lines if not line.startswith(STAGE)), "")
            msg = f"reward: {self.name} cannot be compiled by numba: {reason}"
            raise SceneError(msg) from error
        returned = function.overloads[kinds].signature.return_type
        if not isinstance(returned, types.Float | types.Integer | types.Boolean):
            msg = f"reward: {self.name} returns {returned}; allowed: a number"
            raise SceneError(msg)
        return function

    @cached_property
    def kernel(self) -> Callable[..., int]:
        """The kernel that rewards a step, see `mm_gym.step.own_reward.rewarding`."""
        rows = [(CHANNELS[name].row, CHANNELS[name].subtracted) for name in self.arguments]
        return rewarding(self._cost, rows)

    def costs(self, values: Array) -> Array:
        """Return the costs (n,) of lanes (rows, n), whose derived rows are written.

        They are not finite where the function fails.
        """
        rewards = np.full(values.shape[1], np.nan)
        self.kernel(values, rewards, 0, len(rewards))
        return -rewards

    def check(self, scene: Scene) -> None:
        """Try the cost at states that episodes of a scene reach; raise `SceneError` if it fails.

        Displacements, velocities, accelerations and forces are tried up to their observation
        scales, or beyond if an episode begins or ends beyond them. Actuators are tried up to their
        limits.
        """
        self._check_channels(scene)
        lanes = _probes(scene)
        costs = self.costs(lanes)
        wrong = np.flatnonzero(~np.isfinite(costs))
        if wrong.size:
            raise SceneError(self.fault(lanes[:, wrong[0]]))

    def _check_channels(self, scene: Scene) -> None:
        """Refuse a channel that the sensors of the scene could not show."""
        for rule in Scene.rules:
            if rule.fields[0] == "sensors.channels":
                text = rule.finding(self.arguments, *map(scene.value_of, rule.fields[1:]))
                if text is not None:
                    where = f"reward: {self.name}: the argument"
                    raise SceneError(text.replace("sensors.channels:", where))

    def fault(self, lane: Array) -> str:
        """Return what is wrong with the cost of a lane (rows,): what was returned or raised."""
        values: dict[str, float] = {}
        for name in self.arguments:
            channel = CHANNELS[name]
            subtracted = 0.0 if channel.subtracted == layout.NO_ROW else lane[channel.subtracted]
            values[name] = float(lane[channel.row] - subtracted)
        shown = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
        try:
            found = f"returned {self._cost(*values.values())!r}"
        except Exception as error:  # noqa: BLE001 - whatever a caller's function raises
            found = f"raised {type(error).__name__}: {error}"
        return f"reward: {self.name} {found} for {shown}; allowed: a finite number"

    def first_fault(self, values: Array) -> int:
        """Return the first lane (of columns of values) whose cost is not finite."""
        finite = [np.isfinite(self.costs(lane[:, None])[0]) for lane in values.T]
        return finite.index(False) if False in finite else 0

    def __deepcopy__(self, memo: object) -> Self:
        """Return itself: it does not change."""
        return self

    def __reduce__(self) -> tuple[type[OwnReward], tuple[object]]:
        """Pickle what it was made from: compiled code is of this process."""
        return OwnReward, (self.given,)


class RewardedScene(Scene):
    """A scene whose episodes an own reward scores, in place of its objective; see `rewarded`."""

    _own_reward: OwnReward = PrivateAttr()

    @classmethod
    def of_parts(cls, scene: Scene, own: OwnReward) -> Self:
        """Return a scene with an own reward that has been checked for it."""
        found = cls.model_construct(**dict(scene))
        found._own_reward = own  # noqa: SLF001 - its own
        return found

    @property
    def own_reward(self) -> OwnReward:
        """What rewards its episodes."""
        return self._own_reward

    def replace(self, /, **values: object) -> Scene:
        """Return a validated copy with fields replaced, with the same reward."""
        return rewarded(super().replace(**values), self._own_reward)


def rewarded(scene: Scene, reward: RewardLike | None) -> Scene:
    """Return a scene whose reward is minus your own cost, in every environment and evaluation.

    Its `objective` still provides the scales of the observations, the limits that end an episode,
    and the weights that controllers are designed for.

    Parameters
    ----------
    scene
        A scene.
    reward
        See `OwnReward`; None leaves the scene as it is.

    Raises
    ------
    SceneError
        If the reward is wrong, see `OwnReward`, or its cost is not finite at a state that episodes
        of the scene reach.
    """
    require_scene(scene)
    if reward is None:
        return scene
    own = reward if isinstance(reward, OwnReward) else OwnReward(reward)
    own.check(scene)
    return RewardedScene.of_parts(scene, own)


def _probes(scene: Scene) -> Array:
    """Return lanes (rows, probes): at rest, at one end of every range, at the other, in between."""
    objective, start = scene.objective, scene.initial
    unit = {name: 1.0 * scale for name, (scale, _) in scales(scene).items()}
    lengths = max(unit["displacement"], *map(abs, bounds(start.carriage_displacement)))
    offsets = max(unit["stroke"], *map(abs, bounds(start.sphere_offset)))
    if objective.displacement_limit is not None:
        lengths = max(lengths, BEYOND * objective.displacement_limit)
    if objective.rail_half_length is not None:
        offsets = max(offsets, BEYOND * objective.rail_half_length)
    ends = {
        layout.X1: lengths,
        layout.X2: offsets,
        layout.V1: max(unit["velocity"], *map(abs, bounds(start.carriage_velocity))),
        layout.V2: max(unit["velocity"], *map(abs, bounds(start.sphere_velocity))),
        layout.FORCE: 0.0 if scene.actuation.force is None else scene.actuation.force.limit,
        layout.CARRIAGE_ACCELERATION: unit["acceleration"],
        layout.SPHERE_ACCELERATION: unit["acceleration"],
        layout.SPRING_FORCE: unit["force"],
        layout.DISTURBANCE: unit["force"],
        layout.GROUND_ACCELERATION: unit["acceleration"],
    }
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (layout.M1, PROBES))
    drawn[:, :3] = 0.0, 1.0, -1.0
    lanes = rows_of(layout.M1, PROBES, np.float64)
    for row, end in ends.items():
        lanes[row] = end * drawn[row]
    lanes[layout.X2] += lanes[layout.X1]
    ranges: dict[int, tuple[float, float]] = {}
    if (actuator := scene.actuation.stretch) is not None:
        ranges[layout.STRETCH] = actuator.minimum, actuator.maximum
    elif scene.springs.kind not in WITHOUT_STRETCH:
        stretch = scene.range_of("springs.stretch", scene.value_of("springs.stretch"))
        ranges[layout.STRETCH] = bounds(stretch)
    if (damper := scene.actuation.device) is not None:
        ranges[layout.DAMPING] = damper.minimum, damper.maximum
    for row, (low, high) in ranges.items():
        lanes[row] = 0.5 * (low + high) + 0.5 * (high - low) * drawn[row]
    return lanes
