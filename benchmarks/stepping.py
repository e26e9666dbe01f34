"""Cost of a control step: one environment and many lanes, compared with peers."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle, pairwise, product
from timeit import timeit
from typing import TYPE_CHECKING

import gymnasium
import numba
import numpy as np

from benchmarks.report import table, three_digits
from benchmarks.timing import side_by_side
from mm_gym import MovingMassEnv, MovingMassVectorEnv, compile_scene, load_scene
from mm_gym.lanes import layout
from mm_gym.simulation.lanes import Lanes
from mm_gym.tasks import ids

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from mm_gym import Scene

LANES, MANY_LANES = 16_384, 65_536
ENDLESS = 10**9
ROUNDS, REPEATS = 9, 40
LONGEST = 100  # control steps of an episode, at most

PROCESSOR = "Times are processor time, which other processes on the machine hardly disturb.\n"
UNDISTURBED = f"""Two threads finish when the slower of them does, and on a shared machine other
processes slow them down. The ratio of two times by the clock would mostly measure those processes,
and can exceed 2. Each step of an episode therefore counts with its fastest time of {ROUNDS} rounds,
in which the candidates took turns. ± is half the difference between the results of the even and the
odd rounds. One thread with half of the lanes can take less than half of the time, because less
memory competes for the cache of its processor. The third column is therefore the most that two
threads can reach. The last column shows what two threads reach on this machine with arithmetic that
shares no memory.
"""
EPISODES = f"""{PROCESSOR.strip()} Episodes have at most {LONGEST} control steps under random
actions, and their resets are included. The tasks have their own settings; CarriageForceDuffing, for
example, has a tolerance of 1e-9. The section on speed over accuracy, below, has other tolerances.

"Views" means that `step` returns views of its own arrays, which the next step overwrites; "copies"
means new arrays. The bare product is a reference for the least work: a matrix of 4 x 5 times the
state and the force of every lane.
"""
ENVPOOL = """envpool runs in its synchronous mode with one thread. A step of its FrozenLake, which
only looks into a table, takes about as long as a step of its CartPole.

"""
ACTIONS = 8  # arrays of random actions, used in turns

MANY = {
    name.removeprefix("mm_gym/"): scene.replace(
        **{"control.steps": min(LONGEST, scene.control.steps)}
    )
    for name, scene in ((name, load_scene(name)) for name in ids())
}
"""The tasks, in short episodes."""

PERIOD = 33  # control steps of an episode of which 3 % end in each step, if their ages are random

ENDING = ("CarriageForce-v0", "PreStretch-v0")
AUTORESET = {"NextStep": "next step", "SameStep": "same step"}
ENDS = """The next table compares steps in which no episode ends with steps in which 3 % of the
lanes end an episode and begin another one. These lanes are different in each step.
"""

BARE = "bare 4 x 5 product over the lanes"


def single() -> str:
    """Return the section on single environments, all unwrapped."""
    candidates: dict[str, Callable[[], object]] = {
        name: _step_of_one(load_scene(name)) for name in ids()
    }
    for name in ("MountainCarContinuous-v0", "CartPole-v1"):
        candidates[name] = _step_of_peer(name)
    timings = side_by_side(candidates, clock=time.process_time)
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
        "speed over that of MountainCarContinuous",
        "of CartPole",
    )
    return f"## One environment\n\n{PROCESSOR}\n{table(header, rows)}\n"


def vector() -> str:
    """Return the section on vector environments: all tasks, one core, resets included."""
    candidates: dict[str, Callable[[], object]] = {BARE: _bare_product()}
    for name, scene in MANY.items():
        candidates[f"{name}: compiled kernels alone"] = _kernel_episodes(scene)
        candidates[f"{name}: `step`, views"] = _episodes(scene, copy=False)
        candidates[f"{name}: `step`, copies"] = _episodes(scene, copy=True)
    candidates["Gymnasium CartPole vector"] = _step_of_cart_poles()
    absent: list[str] = []
    for name, peer in {"gymnax": _step_of_gymnax, "envpool": _step_of_envpool}.items():
        try:
            candidates[f"{name} CartPole"] = peer()
        except ImportError as error:
            absent.append(f"{name} ({error})")
    steps = {name: LANES * _steps_of(name) for name in candidates}
    timings = side_by_side(candidates, work=steps, rounds=ROUNDS, clock=time.process_time)
    bare, pole = timings[BARE], timings["Gymnasium CartPole vector"]
    rows = [
        (
            name,
            f"{three_digits(1e-6 / timing.median)} ± {timing.spread * 100:.0f} %",
            f"{timing.times_faster_than(bare) * 100:.1f} %",
            f"{timing.times_faster_than(pole):.3g}",
        )
        for name, timing in timings.items()
    ]
    header = (
        f"{LANES:,} lanes, one core",
        "million steps/s",
        "of the bare product",
        "speed over that of the CartPole vector",
    )
    peers = ENVPOOL if "envpool CartPole" in candidates else ""
    missing = f"Not measured: {'; '.join(absent)}.\n\n" if absent else ""
    return (
        f"## Many lanes\n\n{EPISODES}\n{table(header, rows)}\n\n{peers}{missing}{ENDS}\n{_ends()}\n"
    )


def _ends() -> str:
    """Return the table of steps in which 3 % of the lanes end."""
    rows = []
    for name, (mode, words), copy in product(ENDING, AUTORESET.items(), (False, True)):
        candidates = {
            label: _step_of_ages(MANY[name], steps, mode, copy=copy)
            for label, steps in (("none", ENDLESS), ("some", PERIOD))
        }
        timings = side_by_side(candidates, rounds=ROUNDS, clock=time.process_time)
        none, some = timings["none"], timings["some"]
        rows.append(
            (
                f"{name}, {'copies' if copy else 'views'}, reset in the {words}",
                f"{none.median * 1e6:.0f} ± {none.spread * 100:.0f} %",
                f"{some.median * 1e6:.0f} ± {some.spread * 100:.0f} %",
                f"{none.times_faster_than(some):.2f}",
            )
        )
    header = f"{LANES:,} lanes, one core", "no ends, µs a step", "3 % end", "times as long"
    return table(header, rows)


def _step_of_ages(scene: Scene, steps: int, mode: str, *, copy: bool) -> Callable[[], object]:
    """Return a function that makes a step of lanes whose episodes are of random ages."""
    env = MovingMassVectorEnv(
        scene.replace(**{"control.steps": steps}), LANES, copy=copy, autoreset_mode=mode
    )
    env.reset(seed=0)
    state = env.get_state()
    values = np.array(state["values"])
    values[layout.NOW] = np.random.default_rng(0).integers(0, PERIOD, LANES)
    env.set_state(state | {"values": values})
    actions = _actions(env)
    return lambda: env.step(next(actions))


def threads() -> str:
    """Return the section on two threads: their gain, and the gain that the machine allows."""
    rows = []
    alone, both = (_timed(_independent_work(count)) for count in (1, 2))
    for name, scene in MANY.items():
        for copy in (False, True):
            one, two = (_timed_episodes(scene, count, MANY_LANES, copy=copy) for count in (1, 2))
            half = _timed_episodes(scene, 1, MANY_LANES // 2, copy=copy)
            turns = [(one(), two(), half(), alone(), both()) for _ in range(ROUNDS)]
            times = [np.array(turn) for turn in zip(*turns, strict=True)]  # (rounds, steps)
            gains = (_gain(times[0], times[1]), _gain(times[0], times[2]))
            work = _gain(2.0 * times[3], times[4])
            rows.append((f"{name}, {'copies' if copy else 'views'}", *gains, work))
    header = (
        f"two threads, {MANY_LANES:,} lanes",
        "times as fast as one",
        "one with half of the lanes",
        "independent arithmetic, in the same rounds",
    )
    return f"## Two threads\n\n{UNDISTURBED}\n{table(header, rows)}\n"


def _gain(slow: NDArray[np.float64], fast: NDArray[np.float64]) -> str:
    """Return how many times as fast steps are, from their times (rounds, steps) [s]."""
    rounds = (slice(None), slice(0, None, 2), slice(1, None, 2))
    gain, even, odd = (
        slow[some].min(axis=0).sum() / fast[some].min(axis=0).sum() for some in rounds
    )
    return f"{gain:.2f} ± {abs(even - odd) / 2.0:.2f}"


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


def _steps_of(candidate: str) -> int:
    """Return the control steps in one call of a candidate."""
    scene = MANY.get(candidate.split(":", maxsplit=1)[0])
    return 1 if scene is None else scene.control.steps


def _episodes(scene: Scene, *, copy: bool) -> Callable[[], object]:
    """Return a function that plays a whole episode in every lane, and the reset after it."""
    return _timed_episodes(scene, 1, LANES, copy=copy)


def _timed_episodes(
    scene: Scene, threads: int, lanes: int, *, copy: bool
) -> Callable[[], list[float]]:
    """Return the same for any number of threads; it returns the time of every step [s]."""
    env = MovingMassVectorEnv(scene, lanes, copy=copy, threads=threads)
    env.reset(seed=0)
    actions = _actions(env)

    def play() -> list[float]:
        clock = [time.perf_counter()]
        for _ in range(scene.control.steps + 1):
            env.step(next(actions))
            clock.append(time.perf_counter())
        return [after - before for before, after in pairwise(clock)]

    play()
    return play


def _timed(work: Callable[[], object]) -> Callable[[], list[float]]:
    """Return a function that calls `work` `REPEATS` times and returns the time of each call [s]."""

    def timed() -> list[float]:
        return [timeit(work, number=1) for _ in range(REPEATS)]

    timed()
    return timed


def _actions(env: gymnasium.vector.VectorEnv) -> Iterator[NDArray[np.float32]]:
    """Return random actions in the environment's own memory order, in an endless cycle."""
    env.action_space.seed(0)
    return cycle([np.asfortranarray(env.action_space.sample()) for _ in range(ACTIONS)])


def _kernel_episodes(scene: Scene) -> Callable[[], object]:
    """Return a function that plays an episode with the compiled kernels alone."""
    plant = compile_scene(scene.replace(**{"control.steps": ENDLESS}))
    lanes = Lanes(plant, LANES)
    lanes.seed(0)
    rng = np.random.default_rng(0)
    shape = (ACTIONS, LANES * len(plant.actuators))
    actions = cycle(rng.uniform(-1.0, 1.0, shape).astype(np.float32))

    def play() -> None:
        lanes.restart()
        for _ in range(scene.control.steps):
            lanes.advance(next(actions))

    return play


def _independent_work(count: int) -> Callable[[], object]:
    """Return a function that does arithmetic without memory on `count` threads."""

    @numba.njit(nogil=True)
    def work(repeats: int) -> float:
        total = 0.0
        for _ in range(repeats):
            total = 0.5 * total + 1.0
        return total

    pool = ThreadPoolExecutor(count)
    return lambda: list(pool.map(work, [1_000_000] * count))


def _bare_product() -> Callable[[], object]:
    """Return the minimum of a linear step: the transition matrix times the state."""

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
