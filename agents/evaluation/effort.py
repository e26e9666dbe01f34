"""Response and effort of controllers over those of no control and of the best passive damper."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict

import numpy as np

from agents.evaluation.contestants import Entry, Episodes
from agents.rollout import Rollout
from agents.scoring import spread_frequency
from mm_gym import DesignError, MovingMassVectorEnv, Scene, SimulationError, metrics


def efforts(
    scene: Scene, rows: Sequence[Entry], episodes: Episodes
) -> list[dict[str, str | float]]:
    """Return the indices of every controller of a task, in the episodes of the first seed.

    A row names the controller, what its motions are compared with, and the means over the episodes
    of the indices that `mm_gym.metrics.Indices` explains. Of a training with several seeds it is
    the first run. A scene whose damper cannot be tuned has no passive reference; a carriage without
    mass has no indices.
    """
    seeds = range(episodes.first, episodes.first + episodes.each)
    options = spread_frequency(scene, episodes.each)
    try:
        references = {"no control": metrics.uncontrolled_response(scene, seeds, options)}
    except SimulationError:
        return []
    with suppress(DesignError):
        references["best passive damper"] = metrics.passive_response(scene, seeds, options)
    found: list[dict[str, str | float]] = []
    for row in rows:
        env = MovingMassVectorEnv(scene, len(seeds), autoreset_mode="Disabled")
        rollout = Rollout(env, row.controllers[0], seed=seeds, options=options)
        record = metrics.LaneResponse(env)
        for made in rollout:
            record.add(made.ran)
        response = record.response()
        for name, reference in references.items():
            sensors = len(scene.sensors.channels)
            measured = asdict(metrics.indices(response, reference, sensors=sensors))
            measured.pop("j17")  # the number of the controller's states
            means = {f"{index} [-]": float(np.mean(one)) for index, one in measured.items()}
            found.append({"controller": row.label, "over": name} | means)
    return found
