"""How episodes begin: what is drawn, completed and shown first.

Lanes are taken in runs that a mask treats alike, so that the compiler vectorises the loops over
them.
"""

from __future__ import annotations

import math

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import clip, prefer_widest_vectors, span
from mm_gym.kernels.derived import derive
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.lanes import observe
from mm_gym.kernels.random import next_episode, uniform

STRIDE = 64
"""Lanes of a mask looked at together."""


@borrowing_kernel
def run_end(mask, first):
    """Return the end of the run of lanes, from the first on, that the mask treats alike."""
    last, count, kind = first, mask.shape[0], mask[first]
    while last + STRIDE <= count and is_uniform(mask[last : last + STRIDE], kind):
        last += STRIDE
    while last < count and mask[last] == kind:
        last += 1
    return last


@borrowing_kernel
def is_uniform(mask, kind):
    """Tell whether the mask treats all its lanes alike; without early exit, thus side by side."""
    other = False
    for i in range(mask.shape[0]):
        other |= mask[i] != kind
    return not other


@borrowing_kernel
def draw(template, draws, lanes, streams, mask):
    """Fill the lanes of the mask with the scene's start and draw what is random.

    Draws are rows of (row, low, high). A parameter that is not drawn keeps its value from one
    episode to the next.
    """
    first = 0
    while first < mask.shape[0]:
        last = run_end(mask, first)
        if mask[first]:
            for i in span(first, last):
                next_episode(streams, i)
            for row in range(at.STRETCH + 1):
                fill(lanes, row, template[row], first, last)
            for start in range(first - first % at.BLOCK, last, at.BLOCK):
                stop = min(start + at.BLOCK, last)
                fill(lanes, at.BEGAN, lanes[at.NOW, start], max(start, first), stop)
            for j in range(draws.shape[0]):
                draw_row(lanes, int(draws[j, 0]), draws[j, 1], draws[j, 2], streams, first, last)
        first = last


@borrowing_kernel
def fill(lanes, row, value, first, last):
    """Set a row's lanes to a value."""
    for i in span(first, last):
        lanes[row, i] = value


@borrowing_kernel
def draw_row(lanes, row, low, high, streams, first, last):
    """Draw a row's lanes, uniform in [low, high]."""
    prefer_widest_vectors()
    for i in span(first, last):
        lanes[row, i] = clip(low + (high - low) * uniform(streams, i), low, high)


@borrowing_kernel
def begin(model, task, lanes, mask):
    """Complete drawn lanes: absolute positions, phases, and what rate commands start from.

    Until here row X2 holds the sphere's offset, because that is what a scene states.
    """
    first = 0
    while first < mask.shape[0]:
        last = run_end(mask, first)
        if mask[first]:
            for i in span(first, last):
                lanes[at.X2, i] += lanes[at.X1, i]
            if task[at.FORCE_IS_RATE] > 0.0:
                copy_row(lanes, at.FORCE, at.FORCE_ASKED, first, last)
            if task[at.STRETCH_IS_RATE] > 0.0:
                copy_row(lanes, at.STRETCH, at.STRETCH_ASKED, first, last)
            for j in range(int(model[at.TONE_COUNT])):
                begin_tone(lanes, at.TONES + at.TONE_ROWS * j, model[at.TIME_STEP], first, last)
        first = last


@borrowing_kernel
def copy_row(lanes, source, target, first, last):
    """Copy a row's lanes."""
    for i in span(first, last):
        lanes[target, i] = lanes[source, i]


@borrowing_kernel
def begin_history(model, task, lanes, frames, streams, mask):
    """Fill the history of the lanes of the mask with their first frame."""
    channels, first = int(task[at.CHANNEL_COUNT]), 0
    while first < mask.shape[0]:
        last = run_end(mask, first)
        if mask[first]:
            if task[at.IS_DERIVED] > 0.0:
                derive(model, lanes, first, last)
            observe(task, lanes, frames, streams, first, last)
            for row in range(frames.shape[0] - channels - 1, -1, -1):
                copy_row(frames, row + channels, row, first, last)
        first = last


@borrowing_kernel
def begin_tone(lanes, tone, time_step, first, last):
    """Write cosine and sine of a tone's phase, and of its turn in one substep."""
    for i in span(first, last):
        phase, turn = lanes[tone + at.PHASE, i], lanes[tone + at.FREQUENCY, i] * time_step
        lanes[tone + at.COSINE, i] = math.cos(phase)
        lanes[tone + at.SINE, i] = math.sin(phase)
        lanes[tone + at.ROTATE_COSINE, i] = math.cos(turn)
        lanes[tone + at.ROTATE_SINE, i] = math.sin(turn)
