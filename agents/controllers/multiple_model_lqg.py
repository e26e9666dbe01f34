"""An LQG for each part of the range that a harmonic's frequency is drawn from, weighed by Bayes."""

import re
from collections.abc import Sequence

import numpy as np
from scipy.stats.qmc import Halton

from agents.control.controller import Acted, Controller, Info, Memory, Observation, joined, part
from agents.controllers.lqg import EFFORTS, LQG, weighed, without_force
from agents.controllers.registry import Entry, unless
from agents.controllers.searched import cheapest
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

MODELS = 31
"""With one frequency they are at equal distances. On two structures half as many cost 2 % more."""

FREQUENCY = re.compile(r"excitation\.\d+\.frequency")


class MultipleModelLQG(Controller):
    """The forces of several LQGs, each weighed by the probability of its frequencies.

    Every LQG predicts the next frame, and Bayes' rule weighs it by how probable what is measured is
    then. Anderson and Moore, *Optimal Filtering* (1979), section 10.1. Raise `DesignError` as for
    `design_lqg`.
    """

    def __init__(self, scene: Scene, factor: float = 1.0) -> None:
        drawn = unknown_frequencies(scene)
        low, high = np.array(list(drawn.values())).T
        # The first point is the origin.
        points = Halton(len(drawn), scramble=False).random(MODELS + 1)[1:]
        reach = 0.5 * (high - low) * MODELS ** (-1.0 / len(drawn))
        self.frequencies = low + points * (high - low)  # (models, k): the middles [rad/s]
        self.models = [
            LQG(_near(scene, list(drawn), middles, reach), factor) for middles in self.frequencies
        ]
        covariances = np.array([model.design.innovation for model in self.models])
        self.precisions = np.linalg.inv(covariances)
        self.logarithms = np.linalg.slogdet(covariances).logabsdet
        self.name = f"multiple-model LQG, effort weight times {factor:.2g}"

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        own = {str(k): model.begin(env) for k, model in enumerate(self.models)}
        return {**joined(**own), "evidence": np.zeros((env.num_envs, len(self.models)))}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        own = {str(k): part(memory, str(k)) for k in range(len(self.models))}
        pairs = list(zip(self.models, own.values(), strict=True))
        missed = np.array([model.missed(memory, observation) for model, memory in pairs])
        squares = np.einsum("klp,kpq,klq->lk", missed, self.precisions, missed)
        evidence = memory["evidence"] - 0.5 * (squares + self.logarithms)
        evidence -= evidence.max(axis=1, keepdims=True)
        weights = np.exp(evidence) / np.exp(evidence).sum(axis=1, keepdims=True)
        acted = [model.propose(memory, observation, info) for model, memory in pairs]
        actions = np.einsum("lk,kla->la", weights, [action for action, _ in acted])
        after = {name: memory for name, (_, memory) in zip(own, acted, strict=True)}
        return actions, {**joined(**after), "evidence": evidence}

    def note(self, memory: Memory, action: Array) -> Memory:
        own = {
            str(k): model.note(part(memory, str(k)), action) for k, model in enumerate(self.models)
        }
        return {**joined(**own), "evidence": memory["evidence"]}


def unknown_frequencies(scene: Scene) -> dict[str, tuple[float, float]]:
    """Return the ranges from which frequencies of the excitation are drawn [rad/s], by name."""
    return {name: ends for name, ends in scene.randomization.items() if FREQUENCY.fullmatch(name)}


def _near(scene: Scene, names: Sequence[str], middles: Array, reach: Array) -> Scene:
    """Return a scene with the frequencies named drawn from within a reach of their middles."""
    ends = np.maximum(middles - reach, 0.0), middles + reach
    around = dict(zip(names, np.transpose(ends).tolist(), strict=True))
    at = dict(zip(names, middles.tolist(), strict=True))
    return scene.replace(**at, randomization={**scene.randomization, **around})


def best_multiple_model_lqg(scene: Scene) -> MultipleModelLQG:
    """Search a factor of the force's weight over five decades."""
    own = weighed(scene)
    return cheapest(scene, lambda e: MultipleModelLQG(own, 10.0**e), EFFORTS)


_without_frequency = unless(
    lambda scene: bool(unknown_frequencies(scene)),
    "which finds a harmonic's frequency; randomization: no frequency of the excitation is drawn",
)

ENTRIES = (
    Entry(
        "multiple-model-lqg",
        ("force",),
        best_multiple_model_lqg,
        52,
        "filter",
        "multiple-model LQG",
        lambda scene: _without_frequency(scene) or without_force(scene),
    ),
)
