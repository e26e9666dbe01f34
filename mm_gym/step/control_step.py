"""The entries that Python calls.

They call the kernels of a method and of an interface by address: so all share them, and a second
one that is used is compiled alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mm_gym.arrays import Array, Single
from mm_gym.compiler.addresses import address_of, call
from mm_gym.compiler.jit import LINKED, borrowing_kernel, plain
from mm_gym.excitation.harmonics import rotate
from mm_gym.excitation.impulses import apply_first_impulses
from mm_gym.excitation.kinds import excite, has_corners
from mm_gym.lanes import layout
from mm_gym.law.carriage_spring import are_terminated
from mm_gym.law.interface import LINE, Interface, state_row
from mm_gym.step.crossing import at_none, by_pieces, by_superposition, unchanged
from mm_gym.step.outputs import deriving, observe, pass_frame
from mm_gym.step.task import (
    check_termination,
    command,
    finite,
    hold,
    score,
    score_derived,
    steer,
    task_and_model,
)


class _Kernels(NamedTuple):
    """As of `Entries.kernels`, where none has an address; of a nameless tuple numba warns."""

    propagate: Callable[..., int]
    derive: Callable[..., int]
    cross: Callable[..., int]


class Entries(NamedTuple):
    """Kernels of one method, and an entry of its own if it has one for its simplest scenes."""

    propagate: Callable[..., int]
    whole: Callable[..., int]
    cross: Callable[..., int]
    derive: Callable[..., int]
    takes_parts: bool  # whether `propagate` takes any part of the sample interval
    stops_at_corners: bool
    is_simple: Callable[..., bool] | None
    advance_simply: Callable[..., int] | None

    def advance_of(
        self, task: Array, model: Array, frames: Single, *, excited: bool
    ) -> Callable[..., int]:
        """Return the kernel of a control step for a scene with or without sampled excitation."""
        if self.is_simple and self.advance_simply and plain(self.is_simple)(task, model, frames):
            return self.advance_simply
        return advance if excited else advance_unexcited

    def run_of(self, *, excited: bool) -> Callable[..., int]:
        """Return the kernel of a simulation for such scenes."""
        return run if excited else run_unexcited

    def kernels(self, task: Array, model: Array, lanes: Array, *, excited: bool) -> Any:  # noqa: ANN401 - functions where none has an address
        """Return the addresses of the kernels that these call, for such arrays.

        They are `propagate`, or `whole`; `derive`; and `cross`. Those that are not called are 0.
        """
        propagate = self.propagate if excited else self.whole
        if not LINKED:
            return _Kernels(propagate, self.derive, self.cross)
        found = np.zeros(3, np.int64)
        found[0] = address_of(propagate, model, lanes, 0, 1)
        if task[layout.IS_DERIVED]:
            found[1] = address_of(self.derive, task, model, lanes, 0, 1)
        if excited:
            found[2] = address_of(self.cross, model, lanes, 0, int(found[0]), 0, 1)
        return found


def build(
    propagate: Callable[..., object],
    *,
    simplest: tuple[Callable[..., bool], Callable[..., int]] | None = None,
    whole: Callable[..., object] | None = None,
    respond: Callable[..., None] | None = None,
    shorten: Callable[..., None] = unchanged,
    stops_at_corners: bool = False,
    interface: Interface = LINE,
) -> Entries:
    """Return the entries for a kernel ``propagate(model, lanes, first, last) -> status``.

    It advances the lanes by one sample interval; force and stretch are held over it.

    Parameters
    ----------
    propagate
        The kernel.
    simplest
        A kernel ``(task, model, frames)`` that tells the method's simplest scenes, and the kernel
        that takes for them the place of `_step_with`'s.
    whole
        Another kernel for scenes without sampled excitation, whose sample intervals are all whole.
    respond
        For linear plants, the kernel that adds a response to an impulse, see
        `mm_gym.step.crossing.by_superposition`. Without it `propagate` takes sample intervals of
        any length up to the model's, and stops at impulses.
    shorten
        What else it needs for that, see `mm_gym.step.crossing.by_pieces`.
    stops_at_corners
        Whether it stops at the corners of records too.
    interface
        The force between the masses apart from springs.
    """
    is_simple, at_once = simplest or (None, None)
    if respond is not None:
        cross = by_superposition(respond)
    else:
        cross = by_pieces(has_corners if stops_at_corners else at_none, shorten)
    return Entries(
        propagate,
        whole or propagate,
        cross,
        deriving(interface),
        respond is None,
        stops_at_corners,
        *((is_simple, _advance(at_once)) if at_once else (None, None)),
    )


@borrowing_kernel
def record_state(model, lanes, states, k):
    """Copy the state of lane 0 to states[k]."""
    count = states.shape[1]
    for column in range(count):
        states[k, column] = lanes[state_row(model, column, count), 0]


@borrowing_kernel
def leave(model, lanes, streams, interval, first, last):
    """Do nothing in place of `excite`."""


@borrowing_kernel
def excite_and_apply(model, lanes, streams, interval, first, last):
    """Excite, and apply the impulses at the interval's start, so that a recording shows them."""
    excite(model, lanes, streams, interval, first, last)
    clock = lanes[layout.NOW, first], model[layout.INTERVALS], float(interval)
    apply_first_impulses(model, lanes, clock, first, last)


@borrowing_kernel
def cross_excited(model, lanes, interval, kernels, first, last):
    """Take lanes through a sample interval."""
    return call(kernels[2], (model, lanes, interval, kernels[0], first, last))


@borrowing_kernel
def cross_whole(model, lanes, interval, kernels, first, last):  # noqa: ARG001 - as `cross_excited`
    """Take lanes through a sample interval without sampled excitation."""
    return call(kernels[0], (model, lanes, first, last))


def _advance(step: Callable[..., int]) -> Callable[..., int]:
    """Return the entry that makes a control step by a kernel such as `_step_with` returns."""

    @borrowing_kernel
    def advance(constants, kernels, lanes, frames, ends, streams, actions, rewards, first, last):
        """Make one control step, without resets; none moves if one action is not finite."""
        if not finite(actions):
            return layout.NOT_FINITE
        return step(constants, kernels, lanes, frames, ends, streams, actions, rewards, first, last)

    return advance


def _entries(
    disturb: Callable[..., None],
    disturb_and_apply: Callable[..., None],
    cross: Callable[..., int],
) -> tuple[Callable[..., int], Callable[..., int]]:
    """Return kernels that make a control step and run a simulation.

    `disturb` writes the excitation of a sample interval; `disturb_and_apply` also applies the
    impulses at the interval's start; `cross` takes lanes through it.
    """

    @borrowing_kernel
    def run(model, task, kernels, lanes, streams, commands, starts, states, applied, jets):
        """Simulate lane 0 and record every sample interval.

        Parameters
        ----------
        kernels
            As of `Entries.kernels`.
        commands
            (steps, 2) read: force [N] and stretch [-] asked for in each control step; (steps, 3)
            with the damping [N s/m] behind them if it is actuated.
        starts, states
            (n, 4) written: x1, x2 [m], v1, v2 [m/s] at each sample interval's start and end; the
            interface's own states, if any, are behind them.
        applied
            (n, 2) or (n, 3) written: the same of what is held.
        jets
            (n, 2 terms) written: coefficients of force [N] and ground acceleration [m/s^2] but for
            those of records.
        """
        terms, first = int(model[layout.TERMS]), int(model[layout.JETS])
        for n in range(commands.shape[0]):
            steer(task, lanes, commands[n])
            hold(model, lanes, 0, 1)
            for interval in range(int(model[layout.INTERVALS])):
                k = n * int(model[layout.INTERVALS]) + interval
                disturb_and_apply(model, lanes, streams, interval, 0, 1)
                for column in range(applied.shape[1]):
                    applied[k, column] = lanes[layout.FORCE + column, 0]
                for row in range(2 * terms):
                    jets[k, row] = lanes[first + row, 0]
                record_state(model, lanes, starts, k)
                status = cross(model, lanes, interval, kernels, 0, 1)
                if status > layout.ENDED:
                    return status
                rotate(model, lanes, interval, 0, 1)
                record_state(model, lanes, states, k)
            lanes[layout.NOW, 0] += 1.0
            pass_frame(task, streams, 0, 1)
        return layout.OK

    return _advance(_step_with(disturb, cross)), run


def _step_with(disturb: Callable[..., None], cross: Callable[..., int]) -> Callable[..., int]:
    """Return a kernel that steps lanes block by block, one pass after the other.

    `disturb` and `cross` as for `_entries`.
    """

    @borrowing_kernel
    def move(task, model, kernels, lanes, streams, actions, rewards, first, last):
        """Command, excite, propagate and score the lanes of a block."""
        command(task, lanes, actions, rewards, first, last)
        hold(model, lanes, first, last)
        status = layout.OK
        for interval in range(int(model[layout.INTERVALS])):
            disturb(model, lanes, streams, interval, first, last)
            status = max(status, cross(model, lanes, interval, kernels, first, last))
            if model[layout.HARMONIC_COUNT] > 0.0:
                rotate(model, lanes, interval, first, last)
        return max(status, score(task, lanes, rewards, first, last))

    @borrowing_kernel
    def step(constants, kernels, lanes, frames, ends, streams, actions, rewards, first, last):
        """Make one control step."""
        (task, model), status = task_and_model(constants), layout.OK
        for start in range(first, last, layout.BLOCK):
            stop = min(start + layout.BLOCK, last)
            outcome = move(task, model, kernels, lanes, streams, actions, rewards, start, stop)
            ended = check_termination(task, lanes, ends, start, stop)
            if outcome == layout.ESCAPED and are_terminated(
                lanes, ends, model[layout.SAMPLE_INTERVAL], start, stop
            ):
                outcome = layout.OK
            status = max(status, outcome, ended)
            if task[layout.IS_DERIVED] > 0.0:
                call(kernels[1], (task, model, lanes, start, stop))
            if task[layout.HAS_DERIVED_COST] > 0.0:
                status = max(status, score_derived(task, lanes, rewards, start, stop))
            observe(task, lanes, frames, streams, start, stop)
        return status

    return step


# Most scenes have no excitation but harmonics, so there are entries without the kernels of the
# others: they would take as long to compile as all the rest.
advance, run = _entries(excite, excite_and_apply, cross_excited)
advance_unexcited, run_unexcited = _entries(leave, leave, cross_whole)
