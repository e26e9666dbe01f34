"""Held-out episodes: every controller runs through the same ones."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents.control.controller import Controller, Reads
from agents.rollout import Rollout
from mm_gym import MovingMassVectorEnv, Scene, SceneError
from mm_gym.analysis import spring_energy
from mm_gym.arrays import Array

FREQUENCY = "excitation.0.frequency"  # the field of a scene that is unknown where it is drawn

HELD_OUT_SEED = 1_000_000
"""Seed of the first lane of the final evaluation; training lanes have seeds of another range."""

VALIDATION_SEED = 2_000_000
"""Seed of the first lane of the evaluations during training, and of what baselines are tuned on."""

VALIDATION_EPISODES = 100  # of each of these evaluations
CERTAIN = 1.0 + 1e-9  # of a sum that rounds otherwise than another one of the same terms
DIGITS = 6  # of the numbers in files of scores


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What one controller did."""

    name: str  # the controller's name
    reads: Reads  # what it read: "observation", "full state" or "episode"
    # (episodes,) mean of -reward over the horizon of each, with the terminal cost of an early end
    # [-]; see `evaluate`.
    penalties: Array
    returns: Array  # (episodes,) sum of the rewards of each [-]
    # (episodes,) [rad/s] of the first excitation, or None where its field is not randomised.
    frequency: Array | None
    # time, displacement, applied: (steps,) [s]; (steps, episodes) x1 /
    # objective.displacement_scale; (steps, episodes, k) what the actuators reached. After an early
    # end they keep their last values.
    time: Array
    displacement: Array
    applied: Array
    # (episodes,) energy that changing the stretch put in [J], see `injected`; None where the
    # stretch is not actuated.
    injected: Array | None

    @property
    def cost(self) -> float:
        """Root of the mean of `penalties` [-]: what the task asks for.

        Where only the displacement is rewarded and no episode ends early, it is the same as `rms`.
        """
        return float(np.sqrt(np.mean(self.penalties)))

    @property
    def episode_costs(self) -> Array:
        """(episodes,) the same of each episode [-]."""
        return np.sqrt(self.penalties)

    @property
    def rms(self) -> float:
        """Root mean square of x1 / objective.displacement_scale over all steps [-]."""
        return float(np.sqrt(np.mean(self.displacement**2)))

    @property
    def mean_injected(self) -> float | None:
        """Mean of `injected` over the episodes [J], or None."""
        return None if self.injected is None else float(self.injected.mean())

    @property
    def episode_rms(self) -> Array:
        """(episodes,) the same of each episode [-]."""
        return np.sqrt(np.mean(self.displacement**2, axis=0))


def injected(springs: tuple[Array, Array], offset: Array, stretch: Array) -> Array:
    """Return the most that stretching has given by any time, less what it has taken [J].

    Changing the stretch at an offset does the work by which the springs' energy jumps. Its sum from
    the start of an episode is positive where a law has put in more than it has taken out.

    Parameters
    ----------
    springs
        (lanes,) stiffnesses [N/m] and rest lengths [m], which may be drawn for each episode.
    offset
        (steps, lanes): x2 - x1 at the start of each control step [m].
    stretch
        (steps + 1, lanes): at the start of the episode, and in each control step [-].
    """
    work = np.empty_like(offset)
    for lane, (k0, l0) in enumerate(zip(*springs, strict=True)):
        own, set_to = offset[:, lane], stretch[:, lane]
        work[:, lane] = spring_energy(own, set_to[1:], k0, l0)
        work[:, lane] -= spring_energy(own, set_to[:-1], k0, l0)
    return np.maximum(np.cumsum(work, axis=0).max(axis=0), 0.0)


def spread_frequency(scene: Scene, episodes: int, blocks: int = 1) -> dict[str, Array]:
    """Return the options of a reset that spread an unknown frequency evenly over its band.

    It is spread in each block of the episodes anew; there are no options if it is known.
    """
    band = scene.randomization.get(FREQUENCY)
    if band is None:
        return {}
    return {FREQUENCY: np.tile(np.linspace(*band, episodes // blocks), blocks)}


def limit_penalty(scene: Scene) -> float:
    """Return -reward [-] at the edge of what an episode allows.

    Displacement and offset are at their limits, the action is full. A term of the objective without
    a limit, as the velocity's always is, is at its scale. An own reward tells nothing of an edge.
    """
    if scene.own_reward is not None:
        return -np.inf
    objective = scene.objective
    terms = (
        (objective.displacement_weight, objective.displacement_limit, objective.displacement_scale),
        (objective.velocity_weight, None, objective.velocity_scale),
        (objective.stroke_weight, objective.rail_half_length, objective.stroke_scale),
        (objective.carriage_acceleration_weight, None, objective.carriage_acceleration_scale),
        (objective.sphere_acceleration_weight, None, objective.sphere_acceleration_scale),
        (objective.coupling_force_weight, None, objective.coupling_force_scale),
    )
    motion = sum(
        weight if limit is None else weight * (limit / scale) ** 2 for weight, limit, scale in terms
    )
    return motion + objective.effort_weight * len(scene.actuation.names)


def require_root(scene: Scene, penalty: float) -> None:
    """Raise `SceneError` if an own reward makes a mean penalty [-] negative."""
    if scene.own_reward is not None and penalty < 0.0:
        msg = (
            f"reward: {scene.own_reward.name} is negative on average; allowed for evaluations: a "
            "mean cost of at least 0, because its root is reported"
        )
        raise SceneError(msg)


def evaluate(
    scene: Scene,
    controller: Controller,
    *,
    seed: int = HELD_OUT_SEED,
    episodes: int = 200,
    blocks: int = 1,
    most: float = np.inf,
    worst: float = 1.0,
) -> Evaluation:
    """Run a controller through one episode a lane.

    An unknown frequency is spread evenly over its band, in each block of the episodes anew. All
    episodes end as soon as the mean penalty of the worst share of them is certain to be above
    `most` squared: no penalty falls in a step, but of a reward of one's own, which is not ended.

    The penalty of an episode is the mean of -reward over its horizon of N steps. One that
    terminates after n steps has no reward for the rest and pays a terminal cost. With L, the
    larger of `limit_penalty` and the largest -reward of the n steps::

        penalty = (sum of -reward over the n steps + (N - n) L) / N + L

    So no early end is better than an episode that lasts with a -reward of L at most, and of two
    ends of equal L the later is the better. The return is the sum of the rewards that were got.
    """
    env = MovingMassVectorEnv(scene, episodes, autoreset_mode="Disabled")
    options = spread_frequency(scene, episodes, blocks)
    rollout, steps = Rollout(env, controller, seed=seed, options=options), scene.control.steps
    displacement, rewards = np.empty((steps, episodes)), np.zeros((steps, episodes))
    applied = np.empty((steps, episodes, env.single_action_space.shape[0]))
    springs = None
    if scene.actuation.stretch is not None:
        finite = scene.springs.kind == "finite_stretch"
        lengths = env.drawn("springs.rest_length") if finite else np.zeros(episodes)
        springs = env.drawn("springs.stiffness"), lengths
    info, offset = rollout.info, np.zeros((steps, episodes))
    initial = info["applied"].copy()
    lived, early, step = np.zeros(episodes, np.int64), np.zeros(episodes, np.bool_), 0
    final, penalty = most**2 if scene.own_reward is None else np.inf, np.zeros(episodes)
    at_edge = limit_penalty(scene)
    for step, made in enumerate(rollout):
        for record in (displacement, applied):
            record[step] = record[step - 1]
        offset[step] = info["state"][:, 1] - info["state"][:, 0]
        info, ran = made.info, made.ran
        displacement[step, ran] = info["state"][ran, 0]
        rewards[step, ran] = made.reward[ran]
        applied[step, ran] = info["applied"][ran]
        lived += ran
        ended = made.terminated & ran
        early |= ended
        penalty[ran] -= made.reward[ran] / steps
        penalty[ended] += (2.0 - lived[ended] / steps) * at_edge
        if tail_mean(penalty, worst) > final * CERTAIN:
            break
    for record in (displacement, applied):
        record[step + 1 :] = record[step]
    limit = np.maximum(at_edge, (-rewards).max(axis=0))
    penalties = -rewards.mean(axis=0) + early * (1.0 + (steps - lived) / steps) * limit
    require_root(scene, float(np.mean(penalties)))
    work = None
    if springs is not None:
        tuned = env.plant.actuators.index("stretch")
        stretch = np.concatenate([initial[None], applied])[:, :, tuned]
        work = injected(springs, offset, stretch)
    return Evaluation(
        name=controller.name,
        reads=controller.reads,
        penalties=penalties,
        returns=rewards.sum(axis=0),
        frequency=options.get(FREQUENCY),
        time=scene.control.time_step * np.arange(1, steps + 1),
        displacement=displacement / scene.objective.displacement_scale,
        applied=applied,
        injected=work,
    )


def written(numbers: Mapping[str, float]) -> dict[str, float]:
    """Return numbers as files of scores have them."""
    return {name: float(f"{value:.{DIGITS}g}") for name, value in numbers.items()}


def tail_mean(values: Array, part: float = 0.1) -> Array:
    """Return the mean (...) of the largest part of values (..., n), of at least one: the CVaR."""
    count = values.shape[-1]
    largest = max(1, round(part * count))
    return (np.sort(values, axis=-1)[..., -largest:] if largest < count else values).mean(axis=-1)


def validation_cost(
    scene: Scene,
    controller: Controller,
    worst: float = 1.0,
    episodes: int = VALIDATION_EPISODES,
    *,
    seed: int = VALIDATION_SEED,
    most: float = np.inf,
) -> float:
    """Return a controller's cost on the worst share of the episodes of all validations [-].

    Where it is above `most`, it is another number above it: episodes end as soon as this is known.
    """
    found = evaluate(scene, controller, seed=seed, episodes=episodes, most=most, worst=worst)
    return float(np.sqrt(tail_mean(found.penalties, worst)))
