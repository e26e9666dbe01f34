"""SUNDIALS' CVODE without Python: the library's C interface, called by compiled code.

scikit-sundae brings the library, but calls a Python function for each right-hand side and event.
Here both are compiled, and so is the loop over events.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numba import carray, types

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Values = NDArray[np.float64]

ADAMS, BDF = 1, 2
FIXED_POINT, NEWTON = "fixed point", "Newton"
NORMAL, ROOT_RETURN = 1, 2
"""CVODE's own constants: the task of a call, and what it returns at an event."""

SIZE, ROOTS = 4, 2
BETA, STIFFNESS, DAMPING, C, S, SIDE, VR = 4, 2, 3, 5, 6, 7, 8
"""Slots of the parameters; m1 and m2 come first. `SIDE` is the regime, `VR` 0 without events."""

STICK, LEFT, RIGHT = 0, -1, 1
REGIMES = (STICK, RIGHT, LEFT)  # a regime's index in this tuple is that of its solver
MOST_STEPS = 1_000_000  # steps of a call, which cannot be interrupted otherwise


@cache
def _library() -> ctypes.CDLL:
    """Return SUNDIALS: the names are found through the extension that is linked to it."""
    from sksundae import _cy_cvode  # noqa: PLC0415 - an optional peer

    found = ctypes.CDLL(_cy_cvode.__file__)
    pointer, number, whole, long = ctypes.c_void_p, ctypes.c_double, ctypes.c_int, ctypes.c_long
    signatures = {
        "SUNContext_Create": (whole, whole, pointer),
        "SUNContext_ClearErrHandlers": (whole, pointer),
        "N_VNew_Serial": (pointer, whole, pointer),
        "N_VGetArrayPointer_Serial": (pointer, pointer),
        "SUNDenseMatrix": (pointer, whole, whole, pointer),
        "SUNLinSol_Dense": (pointer, pointer, pointer, pointer),
        "SUNNonlinSol_FixedPoint": (pointer, pointer, whole, pointer),
        "CVodeCreate": (pointer, whole, pointer),
        "CVodeInit": (whole, pointer, pointer, number, pointer),
        "CVodeReInit": (whole, pointer, number, pointer),
        "CVodeSStolerances": (whole, pointer, number, number),
        "CVodeSetLinearSolver": (whole, pointer, pointer, pointer),
        "CVodeSetNonlinearSolver": (whole, pointer, pointer),
        "CVodeSetMaxNumSteps": (whole, pointer, long),
        "CVodeSetStopTime": (whole, pointer, number),
        "CVodeSetUserData": (whole, pointer, pointer),
        "CVodeRootInit": (whole, pointer, whole, pointer),
        "CVodeSetRootDirection": (whole, pointer, pointer),
        "CVode": (whole, pointer, number, pointer, pointer, whole),
    }
    for name, (result, *arguments) in signatures.items():
        function = getattr(found, name)
        function.restype, function.argtypes = result, arguments
    return found


@cache
def _callbacks() -> tuple[Any, Any]:
    """Return the compiled right-hand side and event function, as C calls them."""
    values_of = _library().N_VGetArrayPointer_Serial
    pointer, number = types.voidptr, types.float64

    @numba.cfunc(types.intc(number, pointer, pointer, pointer), error_model="numpy")
    def field(_: float, state: int, rates: int, data: int) -> int:
        y = carray(_as_numbers(values_of(state)), SIZE)
        out = carray(_as_numbers(values_of(rates)), SIZE)
        p = carray(_as_numbers(data), VR + 1)
        x1, v1, v2 = y[0], y[2], y[3]
        force = p[C] * (v2 - v1) + p[S]
        out[0], out[1] = v1, v2
        spring = p[STIFFNESS] * (1.0 + p[BETA] * x1 * x1) * x1
        out[2] = (force - p[DAMPING] * v1 - spring) / p[0]
        out[3] = -force / p[1]
        return 0

    @numba.cfunc(types.intc(number, pointer, types.CPointer(number), pointer))
    def leaving(_: float, state: int, out: Any, data: int) -> int:  # noqa: ANN401 - a C array
        y = carray(_as_numbers(values_of(state)), SIZE)
        p, found = carray(_as_numbers(data), VR + 1), carray(out, ROOTS)
        slip = y[3] - y[2]
        found[0] = (1.0 if p[SIDE] == STICK else p[SIDE]) * slip - p[VR]
        found[1] = -slip - p[VR] if p[SIDE] == STICK else 1.0
        return 0

    return field, leaving


@numba.extending.intrinsic
def _as_numbers(_: object, address: object) -> tuple[Any, Callable[..., Any]]:
    """Return an address as one of double numbers."""
    signature = types.CPointer(types.float64)(address)

    def generate(context: Any, builder: Any, own: Any, values: Any) -> Any:  # noqa: ANN401
        target = context.get_value_type(own.return_type)
        (value,) = values
        if isinstance(own.args[0], types.Integer):
            return builder.inttoptr(value, target)
        return builder.bitcast(value, target)

    return signature, generate


@cache
def _loop() -> Callable[..., int]:
    """Return the compiled loop from event to event; it returns the number of events, or -1."""
    library = _library()
    cvode, begin, stop = library.CVode, library.CVodeReInit, library.CVodeSetStopTime

    @numba.njit
    def loop(solvers: NDArray[np.int64], vector: int, y: Values, until: float, most: int) -> int:
        reached, regime, which = np.zeros(1), STICK, 0
        for events in range(most):
            memory = solvers[which]
            begin(memory, reached[0], vector)
            stop(memory, until)
            outcome = cvode(memory, until, vector, reached.ctypes.data, NORMAL)
            if outcome < 0:
                return -1
            if outcome != ROOT_RETURN:
                return events
            if regime == STICK:
                regime = RIGHT if y[3] > y[2] else LEFT
                which = 1 if regime == RIGHT else 2
            else:
                regime, which = STICK, 0
        return -1

    return loop


class Cvode:
    """CVODE on a motion of two masses: a solver for each regime of friction, all on one state.

    Parameters
    ----------
    method
        `ADAMS` or `BDF`.
    iteration
        How a step's equation is solved: `FIXED_POINT` or `NEWTON`, with a dense Jacobian that CVODE
        takes from differences.
    masses
        m1, m2 [kg], k1 [N/m], d [N s/m], cubic coefficient [1/m^2].
    interfaces
        c [N s/m] and s [N] of each of `REGIMES`; of the first alone without events.
    reference_velocity
        Where a regime ends [m/s]; infinite without events.
    """

    def __init__(
        self,
        method: int,
        iteration: str,
        tolerance: float,
        *,
        masses: Sequence[float],
        interfaces: Sequence[tuple[float, float]],
        reference_velocity: float,
    ) -> None:
        library, (field, leaving) = _library(), _callbacks()
        has_events = bool(np.isfinite(reference_velocity))
        context = ctypes.c_void_p()
        library.SUNContext_Create(0, ctypes.byref(context))
        library.SUNContext_ClearErrHandlers(context)  # what fails is told by a return value
        self.vector = library.N_VNew_Serial(SIZE, context)
        address = library.N_VGetArrayPointer_Serial(self.vector)
        self.state = np.ctypeslib.as_array((ctypes.c_double * SIZE).from_address(address))
        self.state[:] = 0.0
        self.parameters, solvers = np.zeros((len(interfaces), VR + 1)), []
        for regime, (c, s), row in zip(REGIMES, interfaces, self.parameters, strict=False):
            row[:] = *masses, c, s, regime, reference_velocity if has_events else 0.0
            memory = library.CVodeCreate(method, context)
            library.CVodeInit(memory, field.address, 0.0, self.vector)
            library.CVodeSStolerances(memory, tolerance, 1e-3 * tolerance)
            library.CVodeSetUserData(memory, row.ctypes.data)
            library.CVodeSetMaxNumSteps(memory, MOST_STEPS)
            if iteration == FIXED_POINT:
                solver = library.SUNNonlinSol_FixedPoint(self.vector, 0, context)
                library.CVodeSetNonlinearSolver(memory, solver)
            else:
                matrix = library.SUNDenseMatrix(SIZE, SIZE, context)
                solver = library.SUNLinSol_Dense(self.vector, matrix, context)
                library.CVodeSetLinearSolver(memory, solver, matrix)
            if has_events:
                library.CVodeRootInit(memory, ROOTS, leaving.address)
                # Those of sticking are crossed upwards, that of slipping downwards.
                directions = np.array([1, 1] if regime == STICK else [-1, 0], np.intc)
                library.CVodeSetRootDirection(memory, directions.ctypes.data)
            solvers.append(memory)
        self.solvers, self._loop = np.array(solvers), _loop()

    def run(self, start: Values, duration: float, most_events: int) -> bool:
        """Follow the motion from its start; `state` is then its end. Return whether it did."""
        self.state[:] = start
        return self._loop(self.solvers, self.vector, self.state, duration, most_events) >= 0
