"""The two entries that Python calls, built for one method's ``propagate``."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.lanes import approach, command, finite, observe, rotate, score, width_of

if TYPE_CHECKING:
    from collections.abc import Callable


class Entries(NamedTuple):
    """Compiled entries of one method."""

    advance: Callable[..., int]
    run: Callable[..., int]


def build(propagate: Callable[..., object]) -> Entries:
    """Return the entries for a kernel ``propagate(model, lanes, first, last) -> status``."""

    @borrowing_kernel
    def advance(constants, lanes, frames, ends, actions, first, last):
        """Make one control step of the lanes first .. last - 1, without resets; return the status.

        The constants are those of the task, then those of the model: a call costs by its arguments.
        """
        task, model = constants, constants[at.CHANNELS + 3 * int(constants[at.CHANNEL_COUNT]) :]
        if not finite(actions, width_of(task), first, last):
            return at.NOT_FINITE
        status = at.OK
        for start in range(first, last, at.BLOCK):
            stop = min(start + at.BLOCK, last)
            command(task, lanes, actions, start, stop)
            status = max(status, propagate(model, lanes, start, stop))
            rotate(model, lanes, start, stop)
            if score(task, lanes, ends, start, stop):
                status = max(status, at.ENDED)
            observe(task, lanes, frames, start, stop)
        return status

    @borrowing_kernel
    def run(model, task, lanes, commands, states, applied):
        """Simulate lane 0, a row of commands [N, -] a step; write what was reached and applied."""
        force_limit, force_rate = task[at.FORCE_LIMIT], task[at.FORCE_RATE]
        low, high, stretch_rate = task[at.STRETCH_LOW], task[at.STRETCH_HIGH], task[at.STRETCH_RATE]
        for n in range(commands.shape[0]):
            if task[at.HAS_FORCE] > 0.0:
                lanes[at.FORCE, 0] = approach(
                    lanes[at.FORCE, 0], commands[n, 0], force_rate, -force_limit, force_limit
                )
            if task[at.HAS_STRETCH] > 0.0:
                lanes[at.STRETCH, 0] = approach(
                    lanes[at.STRETCH, 0], commands[n, 1], stretch_rate, low, high
                )
            applied[n, 0], applied[n, 1] = lanes[at.FORCE, 0], lanes[at.STRETCH, 0]
            status = propagate(model, lanes, 0, 1)
            if status > at.ENDED:
                return status
            rotate(model, lanes, 0, 1)
            for row in range(4):
                states[n, row] = lanes[row, 0]
        return at.OK

    return Entries(advance, run)
