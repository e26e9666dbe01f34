"""The methods of propagation, one folder each: domain, order, cost and bound, and the kernel.

Arguments that kernels of methods and of sensitivities have in common: `model` (m,), read; `lanes`
(rows, count), read, and the state written; `first, last`, the lanes first .. last - 1; `i, count`
or `first, count`, so many lanes from there on; `i`, one lane; `j`, the number of a harmonic; `n`,
the number of a term; `degree` or `order`, that of a series. A kernel that returns an integer and
says no more of it returns a status, see `mm_gym.lanes.layout`.
"""

from mm_gym.methods.base import Method as Method
from mm_gym.methods.base import Settings as Settings
from mm_gym.methods.cayley_hamilton.method import CayleyHamilton
from mm_gym.methods.fixed_step.method import RK4, SemiImplicitEuler
from mm_gym.methods.linear.method import Linear, Massless
from mm_gym.methods.linear_series.method import ExponentialAction, TruncatedSeries
from mm_gym.methods.runge_kutta.method import RungeKutta
from mm_gym.methods.splitting.method import Splitting
from mm_gym.methods.switched.method import Switched, SwitchedSeries, TruncatedSwitched
from mm_gym.methods.taylor.method import Taylor

METHODS: tuple[Method, ...] = (
    Linear(),
    Massless(),
    TruncatedSeries(),
    CayleyHamilton(),
    ExponentialAction(),
    Switched(),
    TruncatedSwitched(),
    SwitchedSeries(),
    Splitting(),
    RungeKutta(),
    Taylor(),
    RK4(),
    SemiImplicitEuler(),
)
"""The decision table: ``"auto"`` takes the first method that applies and defers to no later one.

A name takes the first so named that applies.
"""


def names() -> list[str]:
    """Return the values of ``solver.method`` other than "auto"."""
    return list(dict.fromkeys(method.name for method in METHODS))
