"""The descent of a recurrent network: torch follows the policy, the engine's Jacobians the physics.

Any network of `agents.network` could be trained so. The small network has a way back of its own,
`agents.gradient.network`: an iteration takes a quarter to a third of the time.
"""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from agents.control.trajectories import FIRST, SECOND
from agents.gradient.episodes import MOST
from agents.gradient.following import Following
from agents.gradient.network import with_oscillators
from agents.gradient.settings import AVERAGED, GradientSettings
from agents.network.layers import (
    GRU,
    Activation,
    Append,
    Clip,
    Correlation,
    Dense,
    Layer,
    Observer,
    Skip,
    run,
)
from agents.network.module import Module
from agents.network.policy import Policy
from agents.training.arrays import Arrays
from agents.training.start import Start
from mm_gym import Scene
from mm_gym.arrays import Array, Single
from mm_gym.torch import Episodes

MOMENTS = ("exp_avg", "exp_avg_sq")  # what torch's Adam remembers of each parameter

OPEN = float(1.0 / (1.0 + np.exp(-2.0)))
"""Of a cell's gates at first: how much they let through, where their slope is still a tenth."""

SMALL = 0.5
"""Size of what a cell remembers at first, over that of the linear memory: a tanh is then linear."""

GATES = 0.3
"""Largest weight of a gate, of which there are as many as units, over one that counts for all."""


def with_cell(start: Start, settings: GradientSettings, generator: np.random.Generator) -> Policy:
    """Return the policy of a start and a recurrent cell, which has no part in the action yet.

    The cell begins as a linear memory: that which predicts a random force, and oscillators. What
    the start itself needs to remember stays in a memory of its own. Correlation units come behind
    the cell, so that what they switch on can depend on it.
    """
    (r, _, shown), h, (k, _) = start.pairs.shape, settings.cell, start.direct.shape
    n = shown - len(start.keep)
    of_memory = start.pairs[:, :, n:], start.direct[:, 1 + n : 1 + shown], start.back
    own = len(start.keep) if any(part.any() for part in of_memory) else 0
    linear = with_oscillators(start, -(-h // 2), generator)
    begun = slice(own, own + h)
    keep, enter = linear.keep[begun, begun], np.pad(linear.enter[begun], ((0, 0), (0, own)))

    def gates(*shape: int) -> Array:
        return generator.uniform(-GATES, GATES, shape) / np.sqrt(h)

    kept, bias = 1.0 - OPEN, np.log(OPEN / (1.0 - OPEN))
    values, inputs = n + own, n + own + h + r
    cell = GRU(
        _single(np.vstack([gates(2 * h, values), SMALL / OPEN * enter])),
        _single(np.vstack([gates(2 * h, h), (keep - kept * np.eye(h)) / OPEN**2])),
        _single(np.repeat([bias, -bias, 0.0, 0.0], h)),
    )
    last, direct = np.split(start.direct, [1], axis=1)
    apart = slice(values, shown)  # columns of a memory that is now in the cell
    direct = np.insert(np.delete(direct, apart, axis=1), [values] * h, 0.0, axis=1)
    pairs = np.pad(np.delete(start.pairs, apart, axis=2), ((0, 0), (0, 0), (0, h)))
    drawn = 1.5 / np.sqrt(inputs) * generator.standard_normal((settings.hidden, 1 + inputs))
    hidden = (
        Dense(_single(drawn[:, 1:]), _single(drawn[:, 0])),
        Activation("tanh"),
        Dense(np.zeros((k, settings.hidden), np.float32), _single(last[:, 0])),
    )
    ends = np.ones(k, np.float32)
    units = (Correlation(_single(pairs), _single(start.units)),) if r else ()
    layers: tuple[Layer, ...] = (
        Append((cell,)),
        *units,
        Skip(hidden, _single(direct)),
        Clip(-ends, ends),
    )
    if own:
        back = start.back if start.back.size else np.zeros((own, k))
        layers = (Observer(layers, *map(_single, (start.keep, start.enter, back))),)
    return Policy(layers, n)


def _single(array: Array) -> Single:
    return array.astype(np.float32)


def _clip(values: Tensor, low: Tensor, high: Tensor, inwards: float) -> Tensor:
    """Return clipped values that have a part of their slope beyond a limit, if it leads inside."""
    clipped = values.detach().clip(low, high)
    beyond = torch.sign(values.detach() - clipped)
    found = clipped + (values - values.detach())  # of slope 1
    found.register_hook(lambda one: ((beyond == 0.0) + inwards * (beyond * one > 0.0)) * one)
    return found


def _arrays(inwards: float) -> Any:  # noqa: ANN401 - a module, or what stands for it
    """Return torch, but with this part of the slopes of what is clipped."""
    if not inwards:
        return torch
    names = {name: getattr(torch, name) for name in ("concatenate", "tanh")}
    return SimpleNamespace(**names, clip=partial(_clip, inwards=inwards))


class RecurrentDescent(Following):
    """A descent from a controller along the gradient, with torch's Adam.

    Attributes
    ----------
    module
        With the parameters as they are.
    mean
        Of the parameters over the last iterations: what is validated.
    """

    def __init__(self, settings: GradientSettings, scene: Scene) -> None:
        super().__init__(settings, scene)
        settings = self.settings
        self.episodes = Episodes(scene, settings.episodes, most=MOST)
        self.module = Module(with_cell(self.began, settings, self.generator))
        self.mean = {name: one.detach().clone() for name, one in self.module.trained.items()}
        rates = {"lr": settings.rate, "betas": (FIRST, SECOND)}
        self.optimiser = torch.optim.Adam(self.module.parameters(), **rates)
        for one in self.module.trained.values():
            zeros = {name: torch.zeros_like(one) for name in MOMENTS}
            self.optimiser.state[one] = {"step": torch.tensor(0.0), **zeros}
        self.frames = settings.episodes * scene.control.steps

    def _slope(self, seeds: list[int], fade: float) -> float:
        self.optimiser.zero_grad()
        self._cost_of(seeds, fade).backward()
        squares = sum((one.grad**2).sum() for one in self.module.trained.values())  # pyright: ignore[reportOptionalOperand] - as `backward` leaves them
        return float(torch.sqrt(squares))  # pyright: ignore[reportArgumentType]

    def _follow(self, rate: float) -> None:
        trained = self.module.trained
        for one in trained.values():
            one.grad /= self.size
        self.optimiser.param_groups[0]["lr"] = rate
        self.optimiser.step()
        for name, one in trained.items():
            self.mean[name].lerp_(one.detach(), max(AVERAGED, 1.0 / (self.rounds + 1)))

    def _cost_of(self, seeds: list[int], fade: float) -> Tensor:
        """Return the mean cost of a step; what is remembered fades as the motion does.

        The last action does not, as the slopes of the motion over the action do not.
        """
        self.episodes.fade = fade
        observation = self.episodes.reset(seed=seeds)
        memory, total = self.module.begin(len(observation)), torch.zeros((), dtype=torch.float64)
        fading = torch.full((self.module.start.remembers,), fade)
        if (observer := self.module.start.find(Observer)) is not None:
            states, actions = observer.back.shape
            fading[states : states + actions] = 1.0
        layers, arrays = self.module.layers, _arrays(self.inwards)
        for _ in range(self.episodes.steps):
            action, memory = run(layers, arrays, observation, memory)
            memory = fading * memory + (1.0 - fading) * memory.detach()
            observation, costs = self.episodes.step(action)
            total = total + costs.mean()
        return total / self.episodes.steps

    def _policy(self, parameters: Arrays) -> Policy:
        return self.module.start.with_arrays(parameters)

    @property
    def _parts(self) -> dict[str, Arrays]:
        trained, of = self.module.trained, self.optimiser.state
        parts = {"parameters": trained, "mean": self.mean}
        for part in (*MOMENTS, "step"):
            parts[part] = {name: of[one][part] for name, one in trained.items()}
        return {
            part: {name: one.detach().numpy() for name, one in own.items()}
            for part, own in parts.items()
        }
