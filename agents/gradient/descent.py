"""The search: Adam on the gradient of the cost of whole episodes through the exact physics.

That is the analytic policy gradient, or backpropagation through time: Freeman, Frey, Raichuk and
others, *Brax - a differentiable physics engine*, NeurIPS 2021; Adam: Kingma and Ba, ICLR 2015. The
policy that is validated is the mean over the last iterations, weighted exponentially (Polyak and
Juditsky, SIAM J. Control Optim. 30, 1992).
"""

from itertools import islice

import numpy as np

from agents.control.trajectories import moved_means
from agents.gradient.episodes import MOST, Episodes
from agents.gradient.following import Following
from agents.gradient.network import (
    REAL,
    Network,
    hold_stable,
    longest,
    parameters_of,
    policy_of,
    shorten,
    with_oscillators,
)
from agents.gradient.settings import AVERAGED, STEEPEST, WARMED, GradientSettings
from agents.policies import Policy
from agents.training.arrays import Arrays
from agents.training.lqg_start import WEIGHTS_OF_MEMORY, settling
from agents.training.network import Network as Evolved
from agents.training.runs import Run
from agents.training.scales import Scales
from agents.training.start import Start
from mm_gym import Scene

BIASES = ("bias", "last")

TOLERANCE = 1e-3
"""Of the motion of a training, where an interface is followed by Runge-Kutta steps: slopes are then
known to a part of 1e-4, far below what they differ by from one draw of episodes to the next."""


def descend(settings: GradientSettings, run: Run, *, bar: bool = True) -> None:
    """Train until iterations or time are used up, and write the best policy to the run's folder.

    Raise as `Search.finish` does, and, before a folder is made, `SceneError`, `CompileError` or
    `DesignError` if there is nothing to search on, or the law or gradients do not apply.
    """
    search = Descent
    if settings.cell:
        from agents.gradient.recurrent import RecurrentDescent as search  # noqa: N813, PLC0415 - torch, which else is unused
    search(settings, settings.rewarded_scene()).finish(run, bar=bar)


class Descent(Following):
    """A descent from a law along the gradient.

    Attributes
    ----------
    parts
        The episodes of each scene, and the passes of the network through them.
    network
        Those through the scene itself, with the parameters as they are.
    sizes
        Of the steps of each parameter, over the rate.
    slope
        The last gradient, over the sizes.
    """

    def __init__(self, settings: GradientSettings, scene: Scene) -> None:
        own = settings.scene is not None
        super().__init__(settings, scene)
        settings = self.settings
        start = settling(scene, self.began) if own else self.began
        start = with_oscillators(start, settings.oscillators, self.generator)
        self.odd = scene.actuation.names == ("force",)
        scales = Scales.measured(scene, start) if own else Scales.stated(start)
        evolved = Evolved(start, settings.hidden, odd=self.odd, scales=scales)
        self.start = evolved.policy(evolved.first(self.generator))
        most = STEEPEST if own and self.odd else MOST
        self.parts = [
            (Episodes(one, count, most, TOLERANCE), Network(self.start, one.control.steps, count))
            for one, count in settings.scenes(scene, settings.episodes)
        ]
        self.network = self.parts[0][1]
        for _, network in self.parts:
            network.parameters = self.network.parameters
        self.mean = parameters_of(self.start)
        self.sizes = _sizes(scales, start)
        self.longest = longest(start.keep)
        zeros = {name: np.zeros_like(array) for name, array in self.mean.items()}
        self.slopes, self.squares = zeros, {name: array.copy() for name, array in zeros.items()}
        self.frames = sum(one.lanes * one.steps for one, _ in self.parts)
        self.warmed = WARMED if own else 1

    def _slope(self, seeds: list[int], fade: float) -> float:
        settings, left = self.settings, iter(seeds)
        for episodes, network in self.parts:
            episodes.run(network, list(islice(left, episodes.lanes)))
            episodes.back(network, fade, settings.feedback, inwards=self.inwards)
        self.slope = {name: self.sizes[name] * slope for name, slope in self._gradient().items()}
        if self.odd:
            for name in BIASES:
                self.slope[name][:] = 0.0
        return float(np.sqrt(sum(float(np.sum(np.square(one))) for one in self.slope.values())))

    def _follow(self, rate: float) -> None:
        sizes, own, count = self.sizes, self.network.parameters, self.rounds + 1
        for name in own:
            slope = self.slope[name] / self.size
            kept, spread = moved_means(slope, self.slopes[name], self.squares[name], count)
            own[name] -= rate / kept * sizes[name] * self.slopes[name] / (spread + 1e-8)
        if "keep" in own:
            if self.settings.scene is not None:
                shorten(own["keep"], self.longest)
            hold_stable(own["keep"], self.longest)
        for name, value in own.items():
            self.mean[name] += max(AVERAGED, 1.0 / count) * (value - self.mean[name])

    def _gradient(self) -> Arrays:
        """Return the slopes of the mean over the episodes of all scenes."""
        total = sum(episodes.lanes for episodes, _ in self.parts)
        weighted = [(one.lanes / total, network.gradient) for one, network in self.parts]
        return {
            name: sum((part * slopes[name] for part, slopes in weighted), REAL(0.0))
            for name in self.mean
        }

    def _told(self) -> dict[str, float]:
        """Return the length of the gradient."""
        return {"search/gradient": self.size}

    def _policy(self, parameters: Arrays) -> Policy:
        return policy_of(parameters, self.start)

    @property
    def _parts(self) -> dict[str, Arrays]:
        return {
            "parameters": self.network.parameters,
            "mean": self.mean,
            "slopes": self.slopes,
            "squares": self.squares,
        }


def _sizes(scales: Scales, start: Start) -> Arrays:
    """Return the sizes of a network's parameters, by role, so that each is of order one over it."""
    x, u, updates = scales.inputs, scales.outputs[:, None], scales.updates[:, None]
    n, shown = start.pairs.shape[2] - len(start.keep), start.pairs.shape[2]
    sizes = {
        "hidden": 1.0 / x,
        "bias": np.ones(1),
        "output": u,
        "last": u[:, 0],
        "pairs": np.ones(1),
        "direct": u / x,
        "keep": updates / x[n:shown],
        "enter": updates / x[:n],
        "back": updates / u[:, 0],
    }
    sizes["early"] = np.hstack([sizes[name] for name in WEIGHTS_OF_MEMORY])
    return {name: size.astype(np.float32) for name, size in sizes.items()}
