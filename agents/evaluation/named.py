"""A controller by what a command is given: a law's name, a run's folder or a policy's file."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from agents.controllers.controller import Controller
from agents.controllers.learned import Learned
from agents.controllers.noise import RandomActions
from agents.controllers.registry import RANDOM, laws, not_a_law
from agents.policies import ENDINGS, load_policy
from agents.training.parts import agent_of, recorded_parts
from agents.training.runs import Run, RunError
from mm_gym import Scene


def law_of(name: str, scene: Scene, generator: np.random.Generator) -> Controller:
    """Return a controller by its name, or the policy of a run's folder or a policy's file.

    The generator is where random actions are drawn from. Raise `SceneError` if the name is not one
    that applies to the scene, nor a path; `RunError` if the training of the run is not over;
    `PolicyError` if the policy cannot be read, or the run has a base in a file of the user's.
    """
    applicable, path = laws(scene), Path(name)
    if name == RANDOM:
        return RandomActions(scene, generator)
    if name in applicable:
        return applicable[name](scene)
    if path.suffix in ENDINGS:
        return Learned(load_policy(path), name)
    run = Run(path.name, path.parent)
    if not os.path.lexists(run.record):
        others = "the folder of a run, or a policy's file"
        raise not_a_law(name, scene, "controller", others)
    if not run.finished:
        msg = f"{run.folder}: training is not finished; continue it: python -m agents train"
        raise RunError(msg)
    record = run.read()
    if record["scene_digest"] != scene.digest:  # its base is the one that it was trained with
        scene = run.scene()
    acts = {name: record["settings"].get(name) for name in ("base", "authority")}
    acts = {name: value for name, value in acts.items() if value is not None}
    parts = recorded_parts(scene, acts, trust=False)  # its own reward has no part in its actions
    return agent_of(run, parts, name)
