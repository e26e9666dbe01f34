"""Exact propagation of a linear plant by a precomputed transition matrix."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.excitation.kinds import excited
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import clip, fma, prefer_widest_vectors
from mm_gym.step.outputs import scaling, shown, shows_state
from mm_gym.step.task import (
    check_termination,
    is_at_once,
    is_lost,
    state_cost,
    state_weights,
    task_and_model,
)

# Slots of the model: 4 rows of the transition matrix, then per harmonic 4 responses to its cosine
# and 4 to its sine, then 4 to each term of both jets; then, with impulses, exp(A dt / 2**k) of each
# of the HALVINGS, row-major (4, 4).
TRANSITION = layout.MODEL_OWN  # [exp(A dt) | response to a held force], row-major (4, 5)
RESPONSES = TRANSITION + 20

HALVINGS = 53
"""Binary digits of a part of the sample interval, as many as a double has."""


@borrowing_kernel
def propagate(model, lanes, first, last):
    """Advance x' = A x + B u + E z by one sample interval; u is held, z turns (Van Loan, 1978)."""
    to_x1, to_x2, to_v1, to_v2 = transition(model)
    x1s, x2s = lanes[layout.X1, first:last], lanes[layout.X2, first:last]
    v1s, v2s = lanes[layout.V1, first:last], lanes[layout.V2, first:last]
    us = lanes[layout.FORCE, first:last]
    for i in range(last - first):
        x1, x2, v1, v2, u = x1s[i], x2s[i], v1s[i], v2s[i], us[i]
        x1s[i] = product(to_x1, x1, x2, v1, v2, u)
        x2s[i] = product(to_x2, x1, x2, v1, v2, u)
        v1s[i] = product(to_v1, x1, x2, v1, v2, u)
        v2s[i] = product(to_v2, x1, x2, v1, v2, u)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        amplitudes = lanes[harmonic + layout.AMPLITUDE, first:last]
        cosines, sines = (
            lanes[harmonic + layout.COSINE, first:last],
            lanes[harmonic + layout.SINE, first:last],
        )
        for row in range(4):
            on_cosine, on_sine = model[RESPONSES + 8 * j + row], model[RESPONSES + 8 * j + 4 + row]
            reached = lanes[row, first:last]
            for i in range(last - first):
                reached[i] += amplitudes[i] * (on_cosine * cosines[i] + on_sine * sines[i])
    terms, jets = int(model[layout.TERMS]), int(model[layout.JETS])
    responses = RESPONSES + 8 * int(model[layout.HARMONIC_COUNT])
    for n in range(2 * terms):
        coefficients = lanes[jets + n, first:last]
        for row in range(4):
            on_term, reached = model[responses + 4 * n + row], lanes[row, first:last]
            for i in range(last - first):
                reached[i] += on_term * coefficients[i]
    return layout.OK


@borrowing_kernel
def respond(model, lanes, time, v1, v2, i):
    """Add to the state of a lane its free motion after given velocities at rest.

    The time is taken digit by digit: for each binary digit of its part of the sample interval there
    is a transition matrix.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; the state is written.
    time
        How long the motion lasts [s]; less than the sample interval.
    v1, v2
        Velocities at its start [m/s].
    i
        The lane.
    """
    x1 = x2 = 0.0
    part, k = time / model[layout.SAMPLE_INTERVAL], RESPONSES
    k += 8 * (int(model[layout.HARMONIC_COUNT]) + int(model[layout.TERMS]))
    for _ in range(HALVINGS):
        part *= 2.0
        if part >= 1.0:
            part -= 1.0
            z = x1, x2, v1, v2
            x1, x2 = _product(model, k, z), _product(model, k + 4, z)
            v1, v2 = _product(model, k + 8, z), _product(model, k + 12, z)
        k += 16
    lanes[layout.X1, i] += x1
    lanes[layout.X2, i] += x2
    lanes[layout.V1, i] += v1
    lanes[layout.V2, i] += v2


@borrowing_kernel
def _product(m, k, z):
    """Return the four coefficients from slot k times a state."""
    return fma(m[k], z[0], fma(m[k + 1], z[1], fma(m[k + 2], z[2], m[k + 3] * z[3])))


@borrowing_kernel
def at_once(constants, kernels, lanes, frames, ends, streams, actions, rewards, first, last):  # noqa: ARG001 - other scenes need `kernels` and the streams
    """Step the simplest scenes in one pass over all lanes; arguments as of other scenes' step.

    What it saves is not arithmetic but memory: each row is read and written once.
    """
    task, model = task_and_model(constants)
    status = _push_score_and_show(task, model, lanes, frames, actions, rewards, first, last)
    for start in range(first, last, layout.BLOCK):
        status = max(
            status, check_termination(task, lanes, ends, start, min(start + layout.BLOCK, last))
        )
    return status


@borrowing_kernel
def is_simple(task, model, frames):
    """Tell whether only a force acts, as commanded, and the state's channels are observed."""
    pushed = task[layout.HAS_FORCE] > 0.0 and not task[layout.HAS_STRETCH] > 0.0
    direct = not (task[layout.FORCE_IS_RATE] > 0.0 or task[layout.FORCE_ROW] > 0.0) and is_at_once(
        task[layout.FORCE_RATE], task[layout.FORCE_LAG_FACTOR]
    )
    alone = model[layout.HARMONIC_COUNT] == 0.0 and not excited(model)
    shown_only = shows_state(task, frames) and not task[layout.IS_DERIVED] > 0.0
    return pushed and direct and alone and shown_only and model[layout.INTERVALS] == 1.0


@borrowing_kernel
def _push_score_and_show(task, model, lanes, frames, actions, rewards, first, last):
    """Command, propagate, score and observe; return the status.

    Parameters
    ----------
    lanes
        (rows, count) read and written: state and force [N].
    frames
        (4, count) float32, written: the observation.
    actions
        (count,) read, in [-1, 1] or beyond.
    rewards
        (count,) float64, written.
    """
    prefer_widest_vectors()
    limit, weight, weights = (
        task[layout.FORCE_LIMIT],
        task[layout.WEIGHT_EFFORT],
        state_weights(task),
    )
    to_x1, to_x2, to_v1, to_v2 = transition(model)
    x1s, x2s = lanes[layout.X1, first:last], lanes[layout.X2, first:last]
    v1s, v2s = lanes[layout.V1, first:last], lanes[layout.V2, first:last]
    us, earned = lanes[layout.FORCE, first:last], rewards[first:last]
    first_frame, second_frame = frames[0, first:last], frames[1, first:last]
    third_frame, fourth_frame = frames[2, first:last], frames[3, first:last]
    (scale1, shift1), (scale2, shift2) = scaling(task, 0), scaling(task, 1)
    (scale3, shift3), (scale4, shift4) = scaling(task, 2), scaling(task, 3)
    asked, lost = actions[first:last], False
    for i in range(last - first):
        a, x1, x2, v1, v2 = clip(asked[i], -1.0, 1.0), x1s[i], x2s[i], v1s[i], v2s[i]
        u = limit * a
        y1, y2 = product(to_x1, x1, x2, v1, v2, u), product(to_x2, x1, x2, v1, v2, u)
        w1, w2 = product(to_v1, x1, x2, v1, v2, u), product(to_v2, x1, x2, v1, v2, u)
        reward = 0.0 - weight * a * a - state_cost(weights, y1, y2, w1)
        x1s[i], x2s[i], v1s[i], v2s[i], us[i], earned[i] = y1, y2, w1, w2, u, reward
        first_frame[i], second_frame[i] = (
            shown(y1, scale1, shift1),
            shown(y2 - y1, scale2, shift2),
        )
        third_frame[i], fourth_frame[i] = shown(w1, scale3, shift3), shown(w2, scale4, shift4)
        lost |= is_lost(reward)
    return layout.DIVERGED if lost else layout.OK


@borrowing_kernel
def transition(model):
    """Return the rows of the transition matrix.

    As scalars: an array would be checked for overlap with every row of lanes before the loop.
    """
    first, fifth = five(model, TRANSITION), five(model, TRANSITION + 5)
    return first, fifth, five(model, TRANSITION + 10), five(model, TRANSITION + 15)


@borrowing_kernel
def five(model, k):
    """Return the five coefficients from slot k."""
    return model[k], model[k + 1], model[k + 2], model[k + 3], model[k + 4]


@borrowing_kernel
def product(m, x1, x2, v1, v2, u):
    """Return a row of the transition matrix times state and force.

    Parameters
    ----------
    m
        The row's five coefficients.
    x1, x2, v1, v2
        State [m, m/s].
    u
        Force on the carriage [N].
    """
    return fma(m[0], x1, fma(m[1], x2, fma(m[2], v1, fma(m[3], v2, m[4] * u))))
