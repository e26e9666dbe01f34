"""Cost of a control step: one environment and many lanes, beside Gymnasium's and other peers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import gymnasium
import numba
import numpy as np

from benchmarks.report import installed, table
from benchmarks.timing import side_by_side
from mm_gym import MovingMassEnv, MovingMassVectorEnv
from mm_gym.tasks import CARRIAGE_FORCE, TASKS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym import Scene

LANES = 16_384
ENDLESS = 10**9


def single() -> str:
    """Return the section on single environments, all unwrapped."""
    candidates: dict[str, Callable[[], object]] = {
        name: _step_of_one(scene) for name, scene in TASKS.items()
    }
    for name in ("MountainCarContinuous-v0", "CartPole-v1"):
        candidates[name] = _step_of_peer(name)
    timings = side_by_side(candidates)
    car, pole = timings["MountainCarContinuous-v0"], timings["CartPole-v1"]
    rows = [
        (
            name,
            f"{timing.median * 1e6:.2f} ± {timing.spread * 100:.0f} %",
            f"{timing.times_faster_than(car):.2f}",
            f"{timing.times_faster_than(pole):.2f}",
        )
        for name, timing in timings.items()
    ]
    header = (
        "environment, unwrapped",
        "µs a step",
        "times faster than MountainCarContinuous",
        "than CartPole",
    )
    return f"## One environment\n\n{table(header, rows)}\n"


def vector() -> str:
    """Return the section on vector environments at 16,384 lanes, resets included, one core."""
    candidates: dict[str, Callable[[], object]] = {
        "bare 4 x 5 product over the lanes": _bare_product()
    }
    for name, scene in TASKS.items():
        candidates[f"{name}, views"] = _step_of_many(scene, copy=False)
        candidates[f"{name}, copies"] = _step_of_many(scene, copy=True)
    candidates["Gymnasium CartPole vector"] = _step_of_cart_poles()
    if installed("gymnax"):
        candidates["gymnax CartPole (jax)"] = _step_of_gymnax()
    if installed("envpool"):
        candidates["EnvPool CartPole (C++)"] = _step_of_envpool()
    timings = side_by_side(candidates, work=LANES)
    bare = timings["bare 4 x 5 product over the lanes"]
    pole = timings["Gymnasium CartPole vector"]
    rows = [
        (
            name,
            f"{1e-6 / timing.median:.1f} ± {timing.spread * 100:.0f} %",
            f"{timing.times_faster_than(bare) * 100:.0f} %",
            f"{timing.times_faster_than(pole):.1f}",
        )
        for name, timing in timings.items()
    ]
    header = (
        f"{LANES:,} lanes, one core",
        "million steps/s",
        "of the bare product",
        "times faster than CartPole vector",
    )
    return f"## Many lanes\n\n{table(header, rows)}\n\n{_threads()}"


def _threads() -> str:
    """Return how two threads compare with one."""
    candidates = {
        f"{threads} threads": _step_of_many(
            CARRIAGE_FORCE, copy=False, threads=threads, lanes=16 * LANES
        )
        for threads in (1, 2)
    }
    timings = side_by_side(candidates, work=16 * LANES)
    factor = timings["2 threads"].times_faster_than(timings["1 threads"])
    lanes = f"{16 * LANES:,} lanes of CarriageForce"
    return f"Two threads step {lanes} {factor:.2f} times as fast as one.\n"


def _step_of_one(scene: Scene) -> Callable[[], object]:
    env = MovingMassEnv(scene.replace(**{"control.steps": ENDLESS}))
    env.reset(seed=0)
    action = env.action_space.sample()
    return lambda: env.step(action)


def _step_of_peer(name: str) -> Callable[[], object]:
    env = gymnasium.make(name).unwrapped
    env.reset(seed=0)
    action = env.action_space.sample()

    def step() -> None:
        if env.step(action)[2]:
            env.reset()

    return step


def _step_of_many(
    scene: Scene, *, copy: bool, threads: int = 1, lanes: int = LANES
) -> Callable[[], object]:
    env = MovingMassVectorEnv(scene, lanes, copy=copy, threads=threads)
    env.reset(seed=0)
    actions = env.action_space.sample()
    return lambda: env.step(actions)


def _bare_product() -> Callable[[], object]:
    """Return the least that a linear step can be: the transition matrix times the state."""

    @numba.njit
    def product(m: NDArray[np.float64], lanes: NDArray[np.float64]) -> None:
        x1s, x2s, v1s, v2s, us = lanes[0], lanes[1], lanes[2], lanes[3], lanes[4]
        for i in range(x1s.size):
            x1, x2, v1, v2, u = x1s[i], x2s[i], v1s[i], v2s[i], us[i]
            x1s[i] = m[0] * x1 + m[1] * x2 + m[2] * v1 + m[3] * v2 + m[4] * u
            x2s[i] = m[5] * x1 + m[6] * x2 + m[7] * v1 + m[8] * v2 + m[9] * u
            v1s[i] = m[10] * x1 + m[11] * x2 + m[12] * v1 + m[13] * v2 + m[14] * u
            v2s[i] = m[15] * x1 + m[16] * x2 + m[17] * v1 + m[18] * v2 + m[19] * u

    lanes, matrix = np.zeros((22, LANES)), np.full(20, 0.1)
    return lambda: product(matrix, lanes)


def _step_of_cart_poles() -> Callable[[], object]:
    env = gymnasium.make_vec("CartPole-v1", num_envs=LANES, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    actions = env.action_space.sample()
    return lambda: env.step(actions)


def _step_of_gymnax() -> Callable[[], object]:
    import gymnax  # noqa: PLC0415 - an optional peer
    import jax  # noqa: PLC0415 - the same

    env, parameters = gymnax.make("CartPole-v1")
    keys = jax.random.split(jax.random.PRNGKey(0), LANES)
    _, state = jax.vmap(env.reset, in_axes=(0, None))(keys, parameters)
    actions = jax.numpy.zeros(LANES, dtype=jax.numpy.int32)
    step = jax.jit(jax.vmap(env.step, in_axes=(0, 0, 0, None)))
    return lambda: jax.block_until_ready(step(keys, state, actions, parameters))


def _step_of_envpool() -> Callable[[], object]:
    import envpool  # noqa: PLC0415 - an optional peer

    env = envpool.make_gymnasium("CartPole-v1", num_envs=LANES, num_threads=1)
    env.reset()
    actions = np.zeros(LANES, np.int32)
    return lambda: env.step(actions)
