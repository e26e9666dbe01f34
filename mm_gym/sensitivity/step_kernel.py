"""A control step for sensitivities, over lanes: without observation, reward and end."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.excitation.harmonics import rotate
from mm_gym.excitation.kinds import excite, excited, has_corners
from mm_gym.lanes import layout
from mm_gym.lanes.memory import copy_row, fill, span
from mm_gym.sensitivity import cubic_kernel, linear_kernel, series_kernel
from mm_gym.sensitivity.layout import FIRST_ROW, LAST_V1, LAST_V2, STATES, TANGENTS, TIME, WIDTH
from mm_gym.step.crossing import by_pieces, by_superposition
from mm_gym.step.outputs import pass_frame
from mm_gym.step.task import command, hold


@borrowing_kernel
def _leave(model, lanes, first, last):
    """Do nothing in place of `begin`, or `finish`."""


@cache
def step_by(
    cross: Callable[..., int],
    begin: Callable[..., None] = _leave,
    finish: Callable[..., None] = _leave,
) -> Callable[..., int]:
    """Return a kernel of a control step.

    `begin` writes the deviations at its start, `finish` those that do not depend on the motion.
    """

    @borrowing_kernel
    def step(task, model, propagate, lanes, streams, actions, first, last):
        """Make one control step of the lanes first .. last - 1, of one block.

        Arguments are those of `mm_gym.step`, and the address of the kernel that propagates them;
        the lanes' rows are followed by those of `sensitivity.layout`.
        """
        status = layout.OK
        command(task, lanes, actions, lanes[lanes.shape[0] - 1], first, last)  # no use of rewards
        hold(model, lanes, first, last)
        begin(model, lanes, first, last)
        for interval in range(int(model[layout.INTERVALS])):
            if excited(model):
                excite(model, lanes, streams, interval, first, last)
            status = max(status, cross(model, lanes, interval, propagate, first, last))
            rotate(model, lanes, interval, first, last)
        finish(model, lanes, first, last)
        lanes[layout.NOW, first] += 1.0
        pass_frame(task, streams, first, last)
        return status

    return step


@cache
def beginning_with(states: int) -> Callable[..., None]:
    """Return a kernel that begins with deviations of so many states, and of nothing else."""

    @borrowing_kernel
    def begin(model, lanes, first, last):
        own, width = int(model[FIRST_ROW]), int(model[WIDTH])
        _begin_motion(model, lanes, first, last)
        for part in range(states):
            for j in range(width):
                value = 1.0 if part == j else 0.0
                fill(lanes, own + TANGENTS + part * width + j, value, first, last)

    return begin


@borrowing_kernel
def _begin_motion(model, lanes, first, last):
    """Write the time since an episode's start, and the velocities before impulses."""
    own, length = int(model[FIRST_ROW]), model[layout.SAMPLE_INTERVAL] * model[layout.INTERVALS]
    copy_row(lanes, layout.V1, own + LAST_V1, first, last)
    copy_row(lanes, layout.V2, own + LAST_V2, first, last)
    for i in span(first, last):
        lanes[own + TIME, i] = (lanes[layout.NOW, first] - lanes[layout.BEGAN, i]) * length


@borrowing_kernel
def _begin_causes(model, lanes, first, last):
    """Begin without deviations where there is a cause; `linear_kernel` writes the other columns."""
    own, width = int(model[FIRST_ROW]), int(model[WIDTH])
    _begin_motion(model, lanes, first, last)
    for part in range(STATES):
        for j in range(STATES, width):
            fill(lanes, own + TANGENTS + part * width + j, 0.0, first, last)


_by_pieces = step_by(by_pieces(has_corners), beginning_with(STATES))
by_series = _by_pieces, series_kernel.propagate
by_cubic_series = _by_pieces, cubic_kernel.propagate
by_linear_series = (
    step_by(by_superposition(linear_kernel.respond), _begin_causes, linear_kernel.write_held),
    linear_kernel.propagate,
)
"""Kernels of a control step, each with the one that propagates."""
