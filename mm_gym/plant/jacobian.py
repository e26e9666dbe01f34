"""The Jacobians of a plant's control step, from what a user gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array
from mm_gym.errors import ActionError, CompileError, SceneError, as_array, refuse
from mm_gym.excitation.kinds import begin_excitation
from mm_gym.lanes import layout
from mm_gym.methods.support import MASSLESS, Support
from mm_gym.plant.idle_friction import FRICTION, require_stick
from mm_gym.plant.point import lane_at, require_parameters
from mm_gym.sensitivity.actuators import actuators_of
from mm_gym.sensitivity.jacobian import Jacobian, Sensitivities
from mm_gym.sensitivity.layout import CAUSED
from mm_gym.step.episodes import complete

FOLLOWED_OF_HARMONICS = (layout.AMPLITUDE, layout.FREQUENCY, layout.PHASE)


def jacobian_of(
    support: Support,
    constants: tuple[Array, Array],
    motion: tuple[ArrayLike | None, ArrayLike],
    place: Mapping[str, Any] | ArrayLike | None,
    parameters: Sequence[str],
) -> Jacobian:
    """Return the Jacobians; see `Plant.jacobian`, whose arguments these are.

    The constants are the arrays of model and task; a motion is state and action.
    """
    model, task = constants
    rows = {name: _followed_row(support, name) for name in parameters}
    values, streams, is_snapshot = _lanes(support, model, task, place)
    state, action = motion
    actuators = actuators_of(task, support.device)
    every = [*support.state_rows, *(a.row for a in actuators)]
    every += [a.asked_row for a in actuators if a.has_memory_of_command]
    sizes, columns = (len(support.state_rows), len(every)), len(actuators)
    given = None if state is None else _array("state", state, sizes, SceneError)
    actions = _array("action", action, (columns,), ActionError)
    counts = {len(a) for a in (given, actions) if a is not None and a.ndim > 1}
    if is_snapshot:
        counts.add(values.shape[1])
    if len(counts) > 1:
        refuse("state, action, at", f"{sorted(counts)} lanes", "as many of each")
    count = counts.pop() if counts else 1
    values = np.array(np.broadcast_to(values, (len(values), count)))
    if given is not None:
        values[every[: given.shape[-1]]] = given.T if given.ndim > 1 else given[:, None]
        if given.shape[-1] == len(every):  # without a lag, what a rate adds up to is applied
            at_once = [a for a in actuators if not a.has_memory_of_command]
            values[[a.asked_row for a in at_once]] = values[[a.row for a in at_once]]
    require_stick(support, values, "state" if given is not None else "at")
    streams = np.array(np.broadcast_to(streams, (2, count)))
    lanes = Sensitivities(support, constants, (values, streams), rows)
    found = lanes.jacobian(np.broadcast_to(actions, (count, columns)).T)
    is_single = not is_snapshot and (given is None or given.ndim == 1) and actions.ndim == 1
    return _first(found) if is_single else found


def _followed_row(support: Support, name: str) -> int:
    """Return the row of a parameter, or raise if no derivative with respect to it is known."""
    row = support.row_of(name)
    if support.kind == MASSLESS:
        msg = "parameters: a carriage without mass has derivatives of state and action only"
        raise CompileError(msg)
    harmonic, own = divmod(row - layout.HARMONICS, layout.HARMONIC_ROWS)
    is_harmonic = 0 <= harmonic < len(support.ground) and own in FOLLOWED_OF_HARMONICS
    is_moved = row == layout.STRETCH and not support.fixed(row)
    follows = {followed for followed, _, _ in support.products}
    is_idle = row in FRICTION and not support.slips
    is_caused = row in CAUSED and not (is_moved or is_idle or row in follows)
    if is_harmonic or row in support.interface_rows or is_caused:
        return row
    msg = (
        f"parameters: {name}: allowed: fields of carriage, sphere, interface and springs that are "
        "neither actuated, nor follow from a ratio, nor belong to friction that never slips, and "
        "amplitude, frequency and phase of harmonics"
    )
    raise SceneError(msg)


def _lanes(
    support: Support, model: Array, task: Array, place: Mapping[str, Any] | ArrayLike | None
) -> tuple[Array, NDArray[np.uint64], bool]:
    """Return lanes (rows, n), their random numbers, and whether they are a snapshot's."""
    streams = np.zeros((2, 1), np.uint64)
    if hasattr(place, "keys") and "values" in place:  # pyright: ignore[reportOperatorIssue]
        return *_of_snapshot(support, cast("Mapping[str, Any]", place)), True
    row = lane_at(support, place, None)  # pyright: ignore[reportArgumentType]
    lanes = row[:, None]
    if place is None or hasattr(place, "keys"):
        which = np.zeros(1, np.int64)
        complete(model, task, lanes, which)
        if support.sampled:
            begin_excitation(model, lanes, streams, which, 0, 1)
    else:
        given = np.asarray(place, np.float64)
        lanes[: layout.DAMPING + 1, 0] = given[: layout.DAMPING + 1]
    return lanes, streams, False


def _of_snapshot(support: Support, snapshot: Mapping[str, Any]) -> tuple[Array, NDArray[np.uint64]]:
    """Return the lanes (rows, n) of a snapshot and their random numbers (2, n)."""
    values = as_array("at.values", snapshot["values"])
    if values.dtype.kind not in "fiu" or values.ndim != 2 or len(values) != len(support.low):  # noqa: PLR2004 - rows and lanes
        got, allowed = f"shape {values.shape} of {values.dtype}", f"({len(support.low)}, lanes)"
        refuse("at.values", got, f"{allowed} numbers")
    values = values.astype(np.float64)
    require_parameters(support, values)
    streams = as_array("at.streams", snapshot.get("streams"))
    if streams.dtype != np.uint64 or streams.shape != (2, values.shape[1]):
        got, allowed = f"shape {streams.shape} of {streams.dtype}", f"(2, {values.shape[1]})"
        refuse("at.streams", got, f"{allowed} of uint64, as get_state returned them")
    return values, streams.astype(np.uint64)


def _array(
    what: str, values: ArrayLike, sizes: tuple[int, ...], error: type[SceneError | ActionError]
) -> Array:
    array = as_array(what, values, error)
    fits = array.ndim in (1, 2) and array.shape[-1] in sizes
    if array.dtype.kind not in "fiu" or not fits or not np.isfinite(array).all():
        allowed = " or ".join(f"({size},) or (lanes, {size})" for size in dict.fromkeys(sizes))
        msg = f"{what}: got shape {array.shape} of {array.dtype}; allowed: {allowed} finite numbers"
        raise error(msg)
    return array.astype(np.float64)


def _first(found: Jacobian) -> Jacobian:
    """Return the Jacobians of the only lane."""
    parameters = {name: value[0] for name, value in found.parameters.items()}
    arrays = (found.end[0], found.state[0], found.action[0], found.applied[0])
    return Jacobian(found.names, *arrays, parameters)
