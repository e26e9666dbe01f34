"""Rows of results for tests: a training, and the best controller, of given penalties."""

import numpy as np

from agents.sweeps.results import Reference, Training
from mm_gym import load_scene

TASK = "mm_gym/CarriageForce-v0"


def training(penalties, seed=0, **fields):
    """Return a training of these penalties, whose validation cost is that of its episodes."""
    episodes = np.sqrt(np.broadcast_to(penalties, 100)).tolist()
    values = {
        "task": TASK,
        "scene_digest": load_scene(TASK).digest,
        "injected": None,
        "episodes": episodes,
        "algorithm": "evolution",
        "seed": seed,
        "settings": "as they are",
        "commit": "none",
        "machine": "any",
        "cost": float(np.sqrt(np.mean(np.square(episodes)))),
        "steps": 1,
        "validation": [float(np.sqrt(np.mean(np.square(episodes))))],
        "seconds": [1.0],
    }
    return Training(**values | fields)


def controller(penalties):
    own = training(penalties).model_dump(include={"task", "scene_digest", "injected", "episodes"})
    return Reference(**own, controller="law", validation=1.0)
