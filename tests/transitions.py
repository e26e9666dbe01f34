"""A check of what a client stores: transitions of a linear task, with ends at different steps.

CarriageForce observes its four states, so an observation is S times the state and the plant's
transition matrix relates each stored observation to the next one. Episodes begin at rest: a reset's
observation that is taken for the end of an episode, or the other way round, breaks the relation.
"""

import numpy as np
from tasks import CARRIAGE_FORCE

from mm_gym import compile_scene

STEPS, LIMIT = 20, 0.0095
CHANGES = {"control.steps": STEPS, "objective.displacement_limit": LIMIT}
SCENE = CARRIAGE_FORCE.replace(**CHANGES)
"""Under random actions most episodes end at the limit, the others at the horizon."""

ROUNDING = 2.0**-24  # largest relative error of a number in single precision


def relation():
    """A, B of next = A observation + B action."""
    objective = SCENE.objective
    x, s, v = objective.displacement_scale, objective.stroke_scale, objective.velocity_scale
    # Rows: carriage_displacement, sphere_offset, carriage_velocity, sphere_velocity.
    observe = np.array(
        [[1 / x, 0, 0, 0], [-1 / s, 1 / s, 0, 0], [0, 0, 1 / v, 0], [0, 0, 0, 1 / v]]
    )
    a, b = compile_scene(SCENE).discrete()
    return observe @ a @ np.linalg.inv(observe), observe @ b * SCENE.actuation.force.limit


def residual_over_bound(observations, actions, following, action_rounding=0.0):
    """The largest |next - A observation - B action| over what rounding to single precision allows.

    Stored observations are rounded once; `action_rounding` is what the client rounds the actions by
    before it stores them.
    """
    a, b = relation()
    before, after = np.float64(observations), np.float64(following)
    residual = np.abs(after - before @ a.T - np.float64(actions) @ b.T)
    bound = ROUNDING * (np.abs(after) + np.abs(before) @ np.abs(a).T)
    bound += action_rounding * np.abs(b).sum(axis=1)
    # The plant and the matrices here are exact to 1e-12 of the scale, which is of order one.
    return float((residual / (bound + 1e-11)).max())


def check_shuffled(observations, actions, following, terminated, *, action_rounding=0.0):
    """Check stored transitions (samples, ...) in any order."""
    assert residual_over_bound(observations, actions, following, action_rounding) <= 1.0
    beyond = np.abs(following[..., 0]) * SCENE.objective.displacement_scale > LIMIT
    np.testing.assert_array_equal(terminated, beyond)
    assert terminated.any()


def check_transitions(
    observations, actions, following, terminated, truncated, *, action_rounding=0.0
):
    """Check stored transitions (steps, lanes, ...) in the order in which they were made."""
    check_shuffled(observations, actions, following, terminated, action_rounding=action_rounding)
    ended = terminated | truncated
    at_rest = (observations[..., 2:] == 0.0).all(axis=-1)
    # The transition after an end begins an episode; any other one continues.
    np.testing.assert_array_equal(ended[:-1], at_rest[1:])
    np.testing.assert_array_equal(following[:-1][~ended[:-1]], observations[1:][~ended[:-1]])
    length = np.zeros(observations.shape[1], int)
    for begins, over, horizon in zip(at_rest, terminated, truncated, strict=True):
        length = np.where(begins, 1, length + 1)
        assert (length <= STEPS).all()
        np.testing.assert_array_equal(horizon | over, (length == STEPS) | over)
    # Ends of both kinds, and not of all lanes at once.
    assert (truncated & ~terminated).any()
    assert observations.shape[1] == 1 or (ended.any(axis=1) & ~ended.all(axis=1)).any()
