"""Controllers as policies, which C, ONNX and NumPy files are written from."""

import numpy as np

from agents.control.controller import Controller
from agents.control.kalman_filter import state_units
from agents.controllers.learned import Learned
from agents.controllers.lqg import LQG
from agents.network.layers import Clip, Dense, Residual, SettlingObserver
from agents.network.policy import Policy
from agents.scoring import validation_cost
from agents.training.parts import base_controller
from mm_gym import MovingMassVectorEnv, Scene, SceneError, compile_scene
from mm_gym.arrays import Array

SMALL = 2.0**-14
"""Observation whose action is not clipped; a power of two, which single precision has exactly."""

ASKED, STEPS = 100, 3
"""Random observations on which a law is checked, in so many steps one after the other."""

CLOSE = 1e-9
"""Largest difference of a linear law from its gains: round-off is less, a second law more."""


def linear_base(base: Controller, scene: Scene) -> Array | None:
    """Return gains and constants (k, n + 1) of a base, or None if it is not a linear law.

    A law is linear if its clipped action is that of its gains on random observations, small and
    large, whatever went before: so one that switches is not. Nor is one whose own memory still
    changes after the first step, as a count of steps does: it may act otherwise later. What a
    source remembers to estimate the state shows within those steps.
    """
    if base.reads != "observation":
        return None
    observed = int(np.prod(MovingMassVectorEnv(scene, 1).single_observation_space.shape))
    env = MovingMassVectorEnv(scene, 1 + observed + ASKED)
    env.reset(seed=0)
    before = memory = base.begin(env)
    generator = np.random.default_rng(0)
    gains = None
    for _ in range(STEPS):
        before = memory
        sizes = generator.choice([SMALL, 0.01, 1.0], (ASKED, 1))
        drawn = sizes * generator.standard_normal((ASKED, observed))
        asked = np.vstack([np.zeros(observed), SMALL * np.eye(observed), drawn]).astype(np.float32)
        proposed, memory = base.propose(memory, asked, {})
        if gains is None:
            constant = proposed[0]
            rows = (proposed[1 : 1 + observed] - constant) / SMALL
            gains = np.column_stack([rows.T, constant])
        wanted = np.clip(asked.astype(np.float64) @ gains[:, :-1].T + gains[:, -1], -1.0, 1.0)
        if not np.allclose(proposed, wanted, rtol=0.0, atol=CLOSE):
            return None
        memory = base.note(memory, proposed)
    own = [name for name in memory if not name.startswith("source/")]
    changed = any(not np.array_equal(memory[name], before[name]) for name in own)
    return None if changed else gains


def residual(policy: Policy, gains: Array, authority: float) -> Policy:
    """Return a policy added to a linear controller of gains and constants (k, n + 1)."""
    base = gains.astype(np.float32)
    return Policy((Residual(policy.layers, base, authority),), policy.observed - len(base))


def controller_policy(name: str, scene: Scene) -> tuple[Policy, str]:
    """Return a controller of a scene, by its name or FILE.py:NAME, as a policy.

    Also in which way they differ, which is empty if they do not. Raise `SceneError` if there is no
    such controller, it is none that can be written as layers, or an LQG's estimate does not begin
    at 0.
    """
    controller = base_controller(scene, name, "controller")
    if type(controller) is LQG:
        policy = _settled(controller, scene)
        own, exported = (validation_cost(scene, one) for one in (controller, Learned(policy)))
        return policy, (
            "Its filter has the gain of an episode's first frame, and from the second the "
            f"stationary one; on the validation episodes it costs {exported:.4g}, and {name}, "
            f"whose gains settle over {len(controller.design.filters)} frames, {own:.4g}."
        )
    gains = linear_base(controller, scene)
    if gains is None:
        msg = (
            f"controller: got {name!r}; allowed for an export: the LQG, and controllers that are "
            "linear in the observation"
        )
        raise SceneError(msg)
    return Policy(_clipped(gains), gains.shape[1] - 1), ""


def _clipped(gains: Array) -> tuple[Dense, Clip]:
    """Return the layers of an action that is linear: of gains and constants (k, n + 1)."""
    single, ends = gains.astype(np.float32), np.ones(len(gains), np.float32)
    return Dense(single[:, :-1], single[:, -1]), Clip(-ends, ends)


def _settled(controller: LQG, scene: Scene) -> Policy:
    """Return an LQG with two of its filter's gains, in units that suit single precision.

    That of an episode's first frame tells where the episode begins; from the second frame on the
    gain is the stationary one. The filter's estimate is a linear memory that knows the clipped
    action. Raise `SceneError` where episodes begin about another state than 0, as the memory does
    not.
    """
    if controller.design.start.any():
        msg = (
            "initial: got motions whose mean is not 0; allowed for an export of the LQG: ranges "
            "about 0, at which its memory begins"
        )
        raise SceneError(msg)
    plant, design, limit = compile_scene(scene), controller.design, controller.limit
    system = design.system
    units = state_units(scene, plant, system)
    shown = [plant.channels.index(signal.name) for signal in system.outputs]
    channels = [plant.observed[k] for k in shown]
    factors = np.array([channel.factor for channel in channels])
    observed = plant.history * len(plant.channels)
    select = np.zeros((len(shown), observed))
    select[range(len(shown)), [observed - len(plant.channels) + k for k in shown]] = 1.0
    zeros = np.array([channel.zero * channel.factor for channel in channels])
    first, enter = (design.filters[k] / factors / units[:, None] for k in (0, -1))
    left = np.eye(len(units)) - enter @ (factors[:, None] * system.C * units)
    predict, push = system.A * units / units[:, None], limit * system.B[:, :1] / units[:, None]
    keep, back = left @ predict, left @ push
    # What is remembered is 0 at the first frame, so that its gain acts on the frame alone.
    early = np.hstack([np.zeros_like(keep), first - enter, np.zeros_like(back)])
    memory = (one.astype(np.float32) for one in (keep, enter, back, early, np.zeros(1)))
    gains = np.concatenate([np.zeros(len(shown)), -design.regulator.gain * units / limit, [0.0]])
    read = Dense(select.astype(np.float32), zeros.astype(np.float32))
    return Policy((read, SettlingObserver(_clipped(gains[None]), *memory)), observed)
