"""What a learner pays: lanes that end at random, resets of a few, and its own reading and storing.

The reader is torch: it passes the observations through a net and copies them into a row-major
rollout buffer. Copies are row-major, views have the kernels' own order, lanes innermost.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
import torch

from benchmarks.report import table
from benchmarks.timing import side_by_side
from mm_gym import MovingMassVectorEnv, load_scene

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Literal

    from numpy.typing import NDArray

    from mm_gym.env.outputs import InfoLevel

LANES = (16_384, 65_536)
TASKS = ("mm_gym/CarriageForce-v0", "mm_gym/PreStretch-v0")
ENDLESS = 10**9
LASTING = 33  # control steps of an episode where 3 % of the lanes end in each step

ROLLOUT = 8
HIDDEN = 64

TEXT = """One thread each for environment and torch. "Ends": 3 % of the lanes end at random in each
step and begin anew in the next. "Reset": `reset` of 1 % of the lanes, chosen at random. "Stored":
a step without information, and a copy of its observations into a row-major rollout buffer of torch:
straight from views; from copies in the lanes' own order; from the row-major copies that the
environment makes by default. "Learner": also a net with a hidden layer of 64, which gives the
actions."""


def learner() -> str:
    """Return the section on what a learner pays in each step."""
    torch.set_num_threads(1)
    warnings.filterwarnings("ignore", message="The given NumPy array is not writable")  # views
    rows = [row for task in TASKS for lanes in LANES for row in _rows(task, lanes)]
    header = ("environment", "µs a step", "times a step with views")
    return f"## A learner's steps\n\n{TEXT}\n\n{table(header, rows)}\n"


def _rows(task: str, lanes: int) -> list[tuple[str, str, str]]:
    copied, viewed = (_made(task, lanes, copy=copy) for copy in (True, False))
    bare_copies, bare_views = (_made(task, lanes, copy=copy, info="none") for copy in (True, False))
    ending = _ending(task, lanes)
    candidates: dict[str, Callable[[], object]] = {
        "step, views": _stepping(viewed),
        "step, views, ends": _stepping(ending),
        "step, copies": _stepping(copied),
        "reset of 1 %, views": _resetting(_made(task, lanes, copy=False)),
        "stored, views": _storing(bare_views),
        "stored, copies in the lanes' order": _storing(bare_views, order="K"),
        "stored, copies": _storing(bare_copies),
        "learner, copies": _learning(copied),
    }
    timings = side_by_side(candidates)
    plain = timings["step, views"]
    return [
        (
            f"{task}, {lanes:,} lanes, {name}",
            f"{timing.median * 1e6:.1f} ± {timing.spread * 100:.0f} %",
            f"{1.0 / timing.times_faster_than(plain):.2f}",
        )
        for name, timing in timings.items()
    ]


def _made(
    task: str, lanes: int, *, copy: bool, info: InfoLevel = "light", steps: int = ENDLESS
) -> MovingMassVectorEnv:
    """Return an environment in which no episode ends before so many steps."""
    scene = load_scene(task).replace(**{"control.steps": steps})
    env = MovingMassVectorEnv(scene, lanes, copy=copy, info=info)
    env.reset(seed=0)
    return env


def _ending(task: str, lanes: int) -> MovingMassVectorEnv:
    """Return an environment in which a random 3 % of the lanes end in each step."""
    env = _made(task, lanes, copy=False, steps=LASTING)
    begin = np.random.default_rng(0).integers(LASTING - 1, size=lanes)
    for step in range(LASTING - 1):
        env.reset(options={"reset_mask": begin == step})
        env.step(_actions(env))
    return env


def _actions(env: MovingMassVectorEnv) -> NDArray[np.float32]:
    """Return random actions in the environment's own memory order."""
    env.action_space.seed(0)
    return np.asfortranarray(env.action_space.sample())


def _stepping(env: MovingMassVectorEnv) -> Callable[[], object]:
    actions = _actions(env)
    return lambda: env.step(actions)


def _resetting(env: MovingMassVectorEnv) -> Callable[[], object]:
    mask = np.random.default_rng(0).random(env.num_envs) < 0.01  # noqa: PLR2004 - 1 %
    return lambda: env.reset(options={"reset_mask": mask})


def _buffer(env: MovingMassVectorEnv) -> torch.Tensor:
    return torch.zeros(ROLLOUT, env.num_envs, *env.single_observation_space.shape)


def _storing(env: MovingMassVectorEnv, order: Literal["K"] | None = None) -> Callable[[], object]:
    """Return a function that steps and stores, maybe from a copy of its own in a memory order."""
    buffer, actions, count = _buffer(env), _actions(env), 0

    def store() -> None:
        nonlocal count
        observations, *_ = env.step(actions)
        read = observations if order is None else observations.copy(order)
        buffer[count % ROLLOUT] = torch.as_tensor(read)
        count += 1

    return store


def _learning(env: MovingMassVectorEnv) -> Callable[[], object]:
    buffer, count = _buffer(env), 0
    size, actuators = buffer.shape[-1], env.single_action_space.shape[0]
    net = torch.nn.Sequential(
        torch.nn.Linear(size, HIDDEN), torch.nn.Tanh(), torch.nn.Linear(HIDDEN, actuators)
    )
    actions = np.zeros(env.action_space.shape, np.float32)

    def learn() -> None:
        nonlocal actions, count
        observations, *_ = env.step(actions)
        read = torch.as_tensor(observations)
        buffer[count % ROLLOUT] = read
        with torch.no_grad():
            actions = net(read).numpy()
        count += 1

    return learn
