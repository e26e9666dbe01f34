"""The descent of a recurrent network: torch follows the policy, the engine's Jacobians the physics.

Any network of `agents.network` could be trained so. The small network has a way back of its own,
`agents.gradient.network`: an iteration takes a quarter to a third of the time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
import torch

from agents.gradient.episodes import MOST
from agents.gradient.settings import AVERAGED, FIRST, SECOND, schedule
from agents.network.layers import (
    GRU,
    UNIT,
    Activation,
    Append,
    Clip,
    Correlation,
    Dense,
    Observer,
    Skip,
)
from agents.network.module import Module
from agents.network.policy import Policy
from agents.training.arrays import part_of
from agents.training.config import training_seeds
from agents.training.search import Search
from agents.training.starts import IN_WORDS, start_of
from mm_gym.torch import Episodes

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from agents.gradient.settings import GradientSettings
    from agents.network.layers import Layer
    from agents.training.arrays import Arrays
    from agents.training.starts import Start
    from mm_gym import Scene

    Values = NDArray[np.float64]

MOMENTS = ("exp_avg", "exp_avg_sq")
"""What torch's Adam remembers of each parameter."""


def with_cell(start: Start, settings: GradientSettings, generator: np.random.Generator) -> Policy:
    """Return the policy of a start and a recurrent cell, which has no part in the action yet."""

    def drawn(*shape: int, fan: int) -> Values:
        return generator.uniform(-1.0, 1.0, shape).astype(np.float32) / np.float32(np.sqrt(fan))

    (r, _, n), h, (k, _) = start.pairs.shape, settings.cell, start.direct.shape
    inputs, m = n + r + h, len(start.keep)
    last, direct = np.split(start.direct.astype(np.float32), [1], axis=1)
    hidden = (
        Dense(drawn(settings.hidden, inputs, fan=inputs), drawn(settings.hidden, fan=inputs)),
        Activation("tanh"),
        Dense(np.zeros((k, settings.hidden), np.float32), last[:, 0]),
    )
    cell = GRU(drawn(3 * h, n + r, fan=h), drawn(3 * h, h, fan=h), drawn(4 * h, fan=h))
    ends = np.ones(k, np.float32)
    units = Correlation(start.pairs.astype(np.float32), start.units.astype(np.float32))
    skip = Skip(hidden, np.pad(direct, ((0, 0), (0, h))))
    layers: tuple[Layer, ...] = (units, Append((cell,)), skip, Clip(-ends, ends))
    if m:
        of = (array.astype(np.float32) for array in (start.keep, start.enter, start.back))
        layers = (Observer(layers, *of),)
    return Policy(layers, n - m)


class RecurrentDescent(Search):
    """A descent from a controller along the gradient, with torch's Adam.

    Attributes
    ----------
    module
        With the parameters as they are.
    mean
        Of the parameters over the last iterations: what is validated.
    """

    unit: ClassVar[str] = "iteration"

    def __init__(self, settings: GradientSettings, scene: Scene) -> None:
        super().__init__(settings, scene)
        self.settings: GradientSettings = settings
        generator = np.random.default_rng(settings.seed)
        start = start_of(scene, settings.model_copy(update={"memory": 0}), generator)
        start.units[:, UNIT.index("floor")] = settings.floor
        self.began_as = IN_WORDS[start.law]
        self.episodes = Episodes(scene, settings.episodes, most=MOST)
        self.module = Module(with_cell(start, settings, generator))
        self.mean = {name: one.detach().clone() for name, one in self.module.trained.items()}
        rates = {"lr": settings.rate, "betas": (FIRST, SECOND)}
        self.optimiser = torch.optim.Adam(self.module.parameters(), **rates)
        for one in self.module.trained.values():
            zeros = {name: torch.zeros_like(one) for name in MOMENTS}
            self.optimiser.state[one] = {"step": torch.tensor(0.0), **zeros}
        self.frames = settings.episodes * scene.control.steps

    @property
    def total(self) -> int:
        """Number of iterations."""
        return self.settings.iterations

    def _advance(self) -> None:
        settings, count, trained = self.settings, self.settings.episodes, self.module.trained
        fade, rate = schedule(settings, self.done)
        self.episodes.fade, self.optimiser.param_groups[0]["lr"] = fade, rate
        self.optimiser.zero_grad()
        self._cost_of(training_seeds(settings.seed, count, self.rounds * count), fade).backward()
        size = torch.sqrt(sum((one.grad**2).sum() for one in trained.values()))  # pyright: ignore[reportArgumentType, reportOptionalOperand] - as `backward` leaves them
        if not 0.0 < float(size) < np.inf:
            return
        for one in trained.values():
            one.grad /= size  # of the gradient only the direction counts
        self.optimiser.step()
        for name, one in trained.items():
            self.mean[name].lerp_(one.detach(), max(AVERAGED, 1.0 / (self.rounds + 1)))

    def _cost_of(self, seeds: range, fade: float) -> Tensor:
        """Return the mean cost of a step; what is remembered fades as the motion does."""
        observation = self.episodes.reset(seed=seeds)
        memory, total = self.module.begin(len(observation)), torch.zeros((), dtype=torch.float64)
        for _ in range(self.episodes.steps):
            action, memory = self.module(observation, memory)
            memory = fade * memory + (1.0 - fade) * memory.detach()
            observation, costs = self.episodes.step(action)
            total = total + costs.mean()
        return total / self.episodes.steps

    def _present(self) -> Arrays:
        return {name: one.numpy().copy() for name, one in self.mean.items()}

    def _policy(self, parameters: Arrays) -> Policy:
        return self.module.start.with_arrays(parameters)

    @property
    def _parts(self) -> dict[str, dict[str, Tensor]]:
        trained, of = self.module.trained, self.optimiser.state
        moments = {part: {name: of[one][part] for name, one in trained.items()} for part in MOMENTS}
        steps = {name: of[one]["step"] for name, one in trained.items()}
        return {"parameters": trained, "mean": self.mean, **moments, "step": steps}

    def _state(self) -> Arrays:
        rounds: Arrays = {"gradient/rounds": np.asarray(self.rounds)}
        for part, own in self._parts.items():
            rounds |= {f"{part}/{name}": one.detach().numpy().copy() for name, one in own.items()}
        return rounds

    def _restore(self, arrays: Arrays) -> None:
        self.rounds = int(arrays["gradient/rounds"])
        with torch.no_grad():
            for part, own in self._parts.items():
                for name, array in part_of(arrays, part).items():
                    own[name].copy_(torch.tensor(array))
