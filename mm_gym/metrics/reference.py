"""Reference motions: without control, and with the best passive damper."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.env.vector import MovingMassVectorEnv
from mm_gym.lanes import layout as at
from mm_gym.metrics.lanes import LaneResponse
from mm_gym.tuning import tune

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from mm_gym.metrics.response import Response
    from mm_gym.scene.scene import Scene


def passive_scene(scene: Scene) -> tuple[Scene, float | None]:
    """Return a scene with the damping of the best passive damper, and its stretch if it has one.

    The damper is that of `mm_gym.tuning.tune` for the carriage's displacement: by "h_infinity" if
    all excitation is harmonic, otherwise by "h2". A seed draws the same episode as in the scene
    itself.

    Raises
    ------
    DesignError
        If the damper cannot be tuned: the interface is dry friction, or a tuned parameter is drawn.
    """
    kinds = {part.kind for part in scene.excitation}
    tuned = tune(scene, criterion="h_infinity" if kinds == {"harmonic"} else "h2")
    if tuned.stretch is None or not isinstance(scene.initial.stretch, tuple):
        return tuned.tuned, tuned.stretch
    return scene.replace(interface=dict(tuned.tuned.interface)), tuned.stretch


def passive_response(
    scene: Scene, seeds: Sequence[int], options: Mapping[str, ArrayLike] | None = None
) -> Response:
    """Return the responses of episodes with the best passive damper, see `passive_scene`.

    Arguments are those of `uncontrolled_response`. Errors include those of `passive_scene`.
    """
    passive, stretch = passive_scene(scene)
    fixed = dict(options or {})
    if stretch is not None and isinstance(scene.initial.stretch, tuple):
        fixed["initial.stretch"] = stretch
    return uncontrolled_response(passive, seeds, fixed)


def uncontrolled_response(
    scene: Scene,
    seeds: Sequence[int],
    options: Mapping[str, ArrayLike] | None = None,
) -> Response:
    """Return the responses of episodes with no force and with the initial stretch.

    Parameters
    ----------
    scene
        The scene.
    seeds
        One seed for each lane.
    options
        Drawn fields to set, as for the reset of `MovingMassVectorEnv`.

    Returns
    -------
    Response
        Response of one episode in each lane, until the episode ends.
    """
    env = MovingMassVectorEnv(scene, len(seeds), autoreset_mode="Disabled", info="none")
    env.reset(seed=list(seeds), options=options)
    record, action = LaneResponse(env), _holding(env)
    alive = np.ones(env.num_envs, np.bool_)
    while alive.any():
        _, _, terminated, truncated, _ = env.step(action)
        record.add(alive)
        ended = terminated | truncated
        alive &= ~ended
        if ended.any() and alive.any():
            env.reset(options={"reset_mask": ended})
    return record.response()


def _holding(env: MovingMassVectorEnv) -> NDArray[np.float64]:
    """Return the actions (lanes, k) of no force and of the present stretch, damping or voltage."""
    actions = np.zeros((env.num_envs, len(env.plant.actuators)))
    values = np.asarray(env.get_state()["values"])
    for k, name in enumerate(env.plant.actuators):
        actuator = getattr(env.scene.actuation, name)
        if name != "force" and actuator.command == "position":
            middle = 0.5 * (actuator.maximum + actuator.minimum)
            half = 0.5 * (actuator.maximum - actuator.minimum)
            actions[:, k] = (values[at.APPLIED[name]] - middle) / half
    return actions
