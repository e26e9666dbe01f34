"""The contract of an interface: the force between sphere and carriage apart from the springs'.

An interface is one constant, which kernels take as an argument and are compiled for: no call and
no choice is left of it. Its force, rate and energy are kernels over every kind of number. A law of
motion is such a constant too.
"""

# ruff: noqa: ARG001, ARG005 - numba gives overloads types, and wants plain functions

from __future__ import annotations

import hashlib
import inspect
from dataclasses import dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numba import types
from numba.extending import models, register_model, typeof_impl

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.compiler.llvm_code import chooses, compiled_as, lower_constant
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.simd import alike

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Bound = Callable[[Sequence[float]], float]


@inlined_kernel
def zero(p, offset, slip, own):
    """Return 0, of the kind of the slip velocity."""
    return alike(slip, 0.0)


@inlined_kernel
def _no_rates(p, offset, slip, own):
    return alike(slip, 0.0), alike(slip, 0.0)


@inlined_kernel
def always(p, before, after, way):
    """Tell that a step sees all of a force, for each lane."""
    return before == before  # noqa: PLR0124 - of its kind


MOST_STATES = 2
"""Of an interface's own."""


def _none(p: Sequence[float]) -> float:
    return 0.0


@dataclass(frozen=True, eq=False)
class Interface:
    """An interface in value form.

    Its force must be continuous in offset, slip velocity and own state: methods look for no events
    of it.

    Attributes
    ----------
    kind
        What ``interface.kind`` calls it.
    parameters
        Names of its fields in a scene, in the order of p; those of other parts with their part.
    force
        Kernel (p, offset [m], slip [m/s], own) -> force on the carriage [N]. Own is a pair: its own
        states, and 0 in place of those that it does not have.
    states
        Names of its own states, `MOST_STATES` at most; they are 0 when an episode begins.
    rates
        Kernel of the same arguments -> the pair of their rates.
    energy
        Kernel of the same arguments -> energy that it stores and can give back [J].
    springs
        Kernel of the same arguments -> the share of springs in its force [N].
    resolves
        Kernel (p, slip before, slip after, way) -> whether a step between these sees all that the
        force does in between: error estimates miss what happens between two stages. It may be as
        long as `way`, in units of the slip over which the force bends.
    is_bent
        Whether the force bends sharply at every change of the slip's direction, where a method of
        high order does not pay.
    damping, stiffness
        Of parameters p -> bound of the force's slope over the slip velocity [N s/m], and over
        offsets near 0, the own states' share included [N/m]. Both rise with each parameter in
        `rising`, and fall with the others.
    rising
        Names of those parameters.
    """

    kind: str
    parameters: tuple[str, ...]
    force: Callable[..., Any]
    states: tuple[str, ...] = ()
    rates: Callable[..., Any] = _no_rates
    energy: Callable[..., Any] = zero
    springs: Callable[..., Any] = zero
    resolves: Callable[..., Any] = always
    is_bent: bool = False
    damping: Bound = _none
    stiffness: Bound = _none
    rising: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        """Return what tells it from others, also of another process and of another text."""
        return self._name

    @property
    def fields(self) -> tuple[str, ...]:
        """Dotted names of the parameters."""
        return tuple(name if "." in name else f"interface.{name}" for name in self.parameters)

    @cached_property
    def _name(self) -> str:
        function = getattr(self.force, "py_func", self.force)
        text = hashlib.sha256(Path(inspect.getfile(function)).read_bytes()).hexdigest()
        return f"{function.__module__}.{self.kind}.{text[:16]}"


@dataclass(frozen=True, eq=False)
class Law(Interface):
    """An interface and what else acts, where kernels are compiled for that too.

    A choice at run time would keep the numbers of all branches in registers, of which there are
    few.

    Attributes
    ----------
    has_friction
        Whether there is dry friction.
    is_finite
        Whether the sphere's springs are of finite stretch, or may be.
    is_excited
        Whether a force or the ground changes within a sample interval, or may do so.
    """

    has_friction: bool = False
    is_finite: bool = False
    is_excited: bool = False

    def __repr__(self) -> str:
        """Return what tells it from others."""
        return f"{self._name}.{self.has_friction:d}{self.is_finite:d}{self.is_excited:d}"


@cache
def law_of(interface: Interface, *, has_friction: bool, is_finite: bool, is_excited: bool) -> Law:
    """Return the law of motion with an interface."""
    own = [getattr(interface, field.name) for field in fields(interface)]
    return Law(*own, has_friction, is_finite, is_excited)


class _Constant(types.Type):
    """The type of one interface or law."""

    def __init__(self, name: str) -> None:
        super().__init__(name)


_known: dict[str, Interface] = {}


@typeof_impl.register(Interface)
def _type_of(interface, _context):
    _known[repr(interface)] = interface
    return _Constant(repr(interface))


register_model(_Constant)(models.OpaqueModel)


@lower_constant(_Constant)
def _constant(context, _builder, _kind, _interface):
    return context.get_dummy_value()


def _kernel_of(answer: Callable[[Interface], Callable[..., Any]]) -> Callable[..., Any]:
    """Return a function that calls a kernel of an interface, with the four arguments of that."""

    def ask(interface, p, x, y, z):
        return answer(interface)(p, x, y, z)

    @chooses(ask)
    def _(interface, p, x, y, z):
        function = answer(_known[interface.name])
        return lambda interface, p, x, y, z: function(p, x, y, z)

    return ask


force_of = _kernel_of(lambda interface: interface.force)
"""Return the force [N] of an interface on the carriage."""

rates_of = _kernel_of(lambda interface: interface.rates)
"""Return the pair of the rates of the own states, 0 of those that there are not."""

springs_of = _kernel_of(lambda interface: interface.springs)
"""Return the share of springs in that force [N]."""


resolves = _kernel_of(lambda interface: interface.resolves)
"""Tell whether a step (interface, p, slip before, slip after, way) sees all of its force."""


def _constant_of(kind: types.Type, answer: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function of an interface whose result kernels know when they are compiled."""

    def ask(interface):
        return answer(interface)

    def built(context, _builder, kinds, _interface):
        return context.get_constant(kind, answer(_known[kinds[0].name]))

    return compiled_as(kind, built)(ask)


states_of = _constant_of(types.int64, lambda interface: 4 + len(interface.states))
"""How many states a motion has: x1, x2, v1, v2, and those of the interface."""

own_states_of = _constant_of(types.int64, lambda interface: len(interface.states))
"""How many there are of the interface."""

parameters_of = _constant_of(types.int64, lambda interface: len(interface.parameters))
"""How many parameters an interface has."""

is_line = _constant_of(types.boolean, lambda interface: interface.force is _line)
"""Whether an interface is a line in each regime."""

has_friction = _constant_of(types.boolean, lambda law: law.has_friction)
is_finite = _constant_of(types.boolean, lambda law: law.is_finite)
is_excited = _constant_of(types.boolean, lambda law: law.is_excited)
"""What `Law` says."""


@inlined_kernel
def state_row(model, k, states):
    """Return the row in a lane of the k-th of a motion's states."""
    return k if k <= layout.V2 else int(model[layout.INTERFACE]) - states + k


@inlined_kernel
def own_at(interface, rows, first):
    """Return the pair of the own states, which are in rows (n,) from `first` on."""
    zero = alike(rows[0], 0.0)
    if own_states_of(interface) > 1:
        return rows[first], rows[first + 1]
    return (rows[first] if own_states_of(interface) > 0 else zero), zero


@inlined_kernel
def _line(p, offset, slip, own):
    return fma(p[0], slip, p[1])


LINE = Interface("line", ("slope", "intercept"), _line)
"""What a viscous interface is, and dry friction in one of its regimes: methods that know more of
these write slope [N s/m] and force at w = 0 [N]."""
