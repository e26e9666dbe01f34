"""Response and effort of controllers over those of no control and of the best passive damper."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.matching_stretch import FREQUENCY
from mm_gym import DesignError, MovingMassVectorEnv, SimulationError, metrics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from agents.comparison.entries import Entry, Episodes
    from agents.controllers.controller import Controller
    from mm_gym import Scene

    Options = dict[str, NDArray[np.float64]]

UNCONTROLLED, PASSIVE = "no control", "best passive damper"


@dataclass(frozen=True)
class Effort:
    """The indices of one controller over one reference, averaged over episodes.

    Attributes
    ----------
    label, reference
        Of the controller, and what its motions are compared with.
    indices
        Name -> mean over the episodes, see `mm_gym.metrics.Indices`.
    """

    label: str
    reference: str
    indices: dict[str, float]


def efforts(scene: Scene, rows: Sequence[Entry], episodes: Episodes) -> list[Effort]:
    """Return the indices of every controller of a task, in the episodes of the first seed.

    Of a training with several seeds it is the first run. A scene whose damper cannot be tuned has
    no passive reference; a carriage without mass has no indices.
    """
    seeds = range(episodes.first, episodes.first + episodes.each)
    band = scene.randomization.get(FREQUENCY)
    options = {} if band is None else {FREQUENCY: np.linspace(*band, episodes.each)}
    try:
        references = {UNCONTROLLED: metrics.uncontrolled_response(scene, seeds, options)}
    except SimulationError:
        return []
    with suppress(DesignError):
        references[PASSIVE] = metrics.passive_response(scene, seeds, options)
    found = []
    for row in rows:
        response = _response(scene, row.controllers[0], seeds, options)
        for name, reference in references.items():
            measured = metrics.indices(response, reference, sensors=len(scene.sensors.channels))
            found.append(Effort(row.label, name, _means(measured)))
    return found


def _response(
    scene: Scene, controller: Controller, seeds: Sequence[int], options: Options
) -> metrics.Response:
    """Return the responses of a controller's episodes, each until it ends."""
    env = MovingMassVectorEnv(scene, len(seeds), autoreset_mode="Disabled")
    observation, info = env.reset(seed=list(seeds), options=options)
    controller.reset(env)
    record, alive = metrics.LaneResponse(env), np.ones(len(seeds), np.bool_)
    while alive.any():
        known = {} if controller.reads == "observation" else info
        observation, _, terminated, truncated, info = env.step(controller.act(observation, known))
        record.add(alive)
        ended = terminated | truncated
        alive &= ~ended
        if ended.any() and alive.any():
            env.reset(options={"reset_mask": ended})
    return record.response()


def _means(indices: metrics.Indices) -> dict[str, float]:
    """Return the means of all indices but the number of the controller's states."""
    return {
        field.name: float(np.mean(getattr(indices, field.name)))
        for field in fields(indices)
        if field.name != "j17"
    }
