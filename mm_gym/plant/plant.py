"""The plant that a scene compiles to: frozen, NumPy only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Context, localcontext
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.arrays import Array
from mm_gym.errors import CompileError, SceneError, as_array, refuse
from mm_gym.excitation.kinds import FIRST
from mm_gym.lanes import layout
from mm_gym.law.springs import LINEAR
from mm_gym.methods import Method, Settings
from mm_gym.methods.support import Support
from mm_gym.plant.linearise import values_about
from mm_gym.plant.state_space import state_space_of
from mm_gym.sensitivity.jacobian import Jacobian
from mm_gym.state_space.equations import StateSpace, state_space
from mm_gym.state_space.linear_system import LinearSystem
from mm_gym.state_space.matrix_exponential import ASSEMBLY_DIGITS
from mm_gym.state_space.transition import transition
from mm_gym.step.control_step import Entries

if TYPE_CHECKING:
    from mm_gym.plant.task import Observed


SCALED = ("peak", "spectral_acceleration")  # what records are scaled to


@dataclass(frozen=True, eq=False)
class Plant:
    """The simplest model that covers everything a scene can reach, ready to be propagated.

    Attributes
    ----------
    method
        The method that propagates the state, with its order, cost and bound.
    settings
        The fields of ``solver`` that the method reads.
    reasons
        Why this method was chosen, one clause each.
    support
        All values that the scene can reach.
    model
        (m,) float64: the constants of the method's kernel.
    task
        (t,) float64: actuators, reward, limits and channels.
    template, draws
        (rows,) float64: the lane at the start of an episode; and (n, 3) float64: row, lower and
        upper limit of each drawn value.
    actuators
        Names of the action's columns, in order: "force" [N], "stretch" [-], "damping" [N s/m],
        "voltage" [V].
    observed
        The channels, in order, each with name, unit, factor, zero, one and noise.
    history, delay
        Number of observed frames, and the age of the newest in control steps (for a drawn delay the
        middle of its range).
    steps, time_step
        Number of control steps in an episode, and the length of a control step [s].
    digest
        Identifier of the scene that the plant was compiled from.
    """

    method: Method
    settings: Settings
    reasons: tuple[str, ...]
    support: Support
    model: Array
    task: Array
    template: Array
    draws: Array
    actuators: tuple[str, ...]
    observed: tuple[Observed, ...]
    history: int
    delay: int
    steps: int
    time_step: float
    digest: str

    @property
    def entries(self) -> Entries:
        """The compiled functions that propagate the plant."""
        return self.method.entries_of(self.support)

    @property
    def kind(self) -> str:
        """The kind of plant; see `mm_gym.methods.support.KINDS`."""
        return self.support.kind

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the observed channels."""
        return tuple(channel.name for channel in self.observed)

    @property
    def frames(self) -> int:
        """Number of frames that a lane stores, the observed ones and the delayed ones to come."""
        return self.history + self.most_delay + bool(self.support.sensors_row)

    @property
    def most_delay(self) -> int:
        """Largest delay of an episode in control steps."""
        return int(self.task[layout.MOST_DELAY]) if self.support.sensors_row else self.delay

    @property
    def records(self) -> dict[str, tuple[str, ...]]:
        """Name of each set of records, as "excitation.0" -> its files, by their numbers.

        ``env.unwrapped.drawn("excitation.0.record")`` is the number of an episode's record.
        """
        return dict(self.support.records)

    def records_of(self, lane: Array) -> dict[str, str]:
        """Return name of each set of records -> the file that a lane (rows,) has."""
        rows = self.support.number_rows
        return {name: files[int(lane[rows[name]])] for name, files in self.records.items()}

    def linear(self, stretch: float | None = None) -> tuple[Array, Array]:
        """Return A (4, 4) and B (4, 1) of x' = A x + B u about equilibrium.

        The input u is the control force [N].
        ``actuation.force.between`` says on which masses the force acts.

        Parameters
        ----------
        stretch
            Stretch of the springs [-]; by default the initial one (the middle of a range).

        Notes
        -----
        A range is replaced by its middle, a cubic spring by its tangent, and dry friction by its
        slope in stick. The equilibrium is x1 = 0, which is unstable with
        ``carriage.linear_coefficient`` < 0: A then has an eigenvalue greater than 0.

        Raises
        ------
        SceneError
            If the stretch is below 1 or not finite.
        CompileError
            If the carriage has no mass.
        """
        system = self.system(stretch)
        b = system.control(is_between=self.support.is_between)
        return system.a.astype(np.float64), b.astype(np.float64)[:, None]

    def discrete(self, stretch: float | None = None) -> tuple[Array, Array]:
        """Return Ad (4, 4) and Bd (4, 1) of the sampled plant x_next = Ad x + Bd u.

        The force u [N] is held over each control step. Parameters and linearisation are those of
        `linear`; a carriage without mass is allowed.
        """
        values = values_about(self.support, self._middle(stretch))
        both = transition(values, self.time_step, is_between=self.support.is_between)
        return both[:, :4], both[:, 4:]

    def system(self, stretch: float | None = None) -> StateSpace:
        """Return the linear equations about equilibrium in decimal arithmetic; see `linear`."""
        row = self._middle(stretch)
        if row[layout.M1] == 0.0:
            msg = "carriage.mass: 0 leaves three states, so there is no A (4, 4); use discrete()"
            raise CompileError(msg)
        values = values_about(self.support, row)
        with localcontext(Context(prec=ASSEMBLY_DIGITS)):
            return state_space(values)

    def state_space(
        self,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        *,
        sampled: bool = False,
        at: Mapping[str, float] | ArrayLike | None = None,
        about: ArrayLike | None = None,
    ) -> LinearSystem:
        """Return the plant as A, B, C, D with names and units; see docs/tuning.md.

        Parameters
        ----------
        inputs
            Any of "force" [N], "stretch" [-], "damping" [N s/m] and "voltage" [V], as commanded to
            the actuators, with their lag; "disturbance" [N] on the carriage and "ground" [m/s^2].
            By default the scene's actuators. Limits and rate limits are left out.
        outputs
            Channels, in SI units, or the states "x1", "x2", "v1", "v2". By default the channels
            that the scene observes. Channels have the delay of the sensors; states have none.
        sampled
            Whether the system is the map of one control step, with all inputs held over it and the
            sensors' delay as states, or continuous.
        at
            Values by dotted name, or a lane (rows,), such as `Trajectory.parameters` or
            ``env.unwrapped.get_state()["values"][:, 0]``; by default the middle of every range.
            Sensors and actuators always have the middle of their ranges.
        about
            (4,) x1, x2 [m], v1, v2 [m/s] about which a nonlinear plant and the effects of stretch,
            damping and voltage are linearised; by default the equilibrium, where the last three
            have no effect.

        Returns
        -------
        LinearSystem
            Harmonics of the scene are states without input. Noise is white noise that drives the
            states of its filter, with the envelope 1. Random impulses are white noise. Sweeps,
            records and impulses at given times are left out.

        Raises
        ------
        SceneError
            If a name is unknown, or a value is not allowed.
        CompileError
            If the carriage has no mass.
        """
        return state_space_of(
            self.support,
            self.task,
            (self.observed, self.delay),
            self.actuators if inputs is None else inputs,
            self.channels if outputs is None else outputs,
            sampled=sampled,
            at=at,
            about=about,
        )

    def jacobian(
        self,
        state: ArrayLike | None,
        action: ArrayLike,
        *,
        at: Mapping[str, Any] | ArrayLike | None = None,
        parameters: Sequence[str] = (),
    ) -> Jacobian:
        """Return the derivatives of the state at the end of a control step; see docs/numerics.md.

        Parameters
        ----------
        state
            (4,) x1, x2 [m], v1, v2 [m/s] at the start of the step, or (lanes, 4), followed by the
            interface's own states if it has any. Or everything that `Jacobian.names` lists, as at
            the end of a previous step. None takes the state of `at`.
        action
            (k,) in [-1, 1], in the order of `actuators`, or (lanes, k). Values outside are clipped;
            their derivatives are zero.
        at
            All other initial values: by dotted name, or as a lane (rows,), as for `state_space`; or
            as a snapshot, ``env.unwrapped.get_state()``, with all its lanes and their random
            numbers. By default the start of an episode, with the middle of every range.
        parameters
            Dotted names of fields. Each derivative holds all other fields constant: for example,
            the normal force when a mass changes.

        Returns
        -------
        Jacobian
            The state at the end and its derivatives, with a leading axis of lanes if one of the
            arguments has lanes. At a limit of an actuator the derivatives are those on its inner
            side. Random excitation is held constant.

        Raises
        ------
        SceneError
            If a name is unknown or has no derivative, or state or lanes have another shape.
        ActionError
            If the action has another shape or is not finite.
        CompileError
            If parameters of a carriage without mass are asked for.
        SimulationError
            If the step cannot be completed.
        """
        from mm_gym.plant.jacobian import jacobian_of  # noqa: PLC0415 - a first step needs none

        constants = self.model, self.task
        return jacobian_of(self.support, constants, (state, action), at, parameters)

    def scored_reactions(self, lanes: Array, model: Array | None = None) -> Array:
        """Return the accelerations that the objective squares, at the end of a step.

        Parameters
        ----------
        lanes
            (rows, n) as of ``env.unwrapped.get_state()["values"]``, read.
        model
            (m,) of other excitation, as `mm_gym.sensitivity.expected` has it; by default its own.

        Returns
        -------
        (2, n)
            Accelerations of carriage and sphere, each times the root of its weight [-]; that of the
            sphere stands for the force between the masses, too. The sum of squares is their cost.
        """
        derived = lanes.copy()
        if self.support.damped_row:
            derived[self.support.damped_row] = derived[layout.DAMPING]
        given = self.model if model is None else model
        self.entries.derive(self.task, given, derived, 0, lanes.shape[1])
        slots = layout.WEIGHT_CARRIAGE_ACCELERATION, layout.WEIGHT_SPHERE_ACCELERATION
        carriage, sphere = self.task[list(slots)]
        sphere = sphere + self.task[layout.WEIGHT_COUPLING_FORCE] * derived[layout.M2] ** 2
        # Without mass the carriage's is not finite, and has no weight.
        own = derived[layout.CARRIAGE_ACCELERATION] if carriage > 0.0 else np.zeros(lanes.shape[1])
        return np.stack(
            [np.sqrt(carriage) * own, np.sqrt(sphere) * derived[layout.SPHERE_ACCELERATION]]
        )

    @property
    def scores_reactions(self) -> bool:
        """Whether the objective weighs accelerations or the force between the masses."""
        return bool(self.task[layout.HAS_DERIVED_COST])

    def _middle(self, stretch: float | None) -> Array:
        """Return the lane (rows,) with the middle of every range, and a stretch [-]."""
        middle = self.support.middle
        middle[layout.X1 : layout.V2 + 1] = 0.0
        if stretch is not None:
            number = as_array("stretch", stretch)
            if number.dtype.kind not in "fiu" or number.shape or not 1.0 <= float(number) < np.inf:
                refuse("stretch", f"{stretch!r}", "a finite number of at least 1")
            if layout.STRETCH not in self.support.names.values():
                kind = "linear" if middle[layout.STRETCH] == LINEAR else "none"
                msg = f"stretch: springs.kind = {kind!r} has no stretch; leave it out"
                raise SceneError(msg)
            middle[layout.STRETCH] = stretch
        return middle

    def at_interval(self, interval: float) -> Plant:
        """Return the plant with another length of the sample interval [s]."""
        return _at_interval(self, interval)

    def explain(self) -> str:
        """Return the plant, the reasons, the method, its order, cost and error bound as text."""
        method, many = self.method, self.support.intervals_per_step
        cost = method.cost(self.model)
        if many > 1:
            cost += f" in each of {many} sample intervals"
        lines = [
            ("plant", self.kind),
            ("because", "; ".join(self.reasons)),
            ("method", f"{method.name}: {method.how}"),
            ("order", method.order(self.settings)),
            ("cost", cost),
            ("error", method.bound(self.settings)),
        ]
        lines += [("records", self._set_of_records(name)) for name in self.support.records]
        return "\n".join(f"{title:8} {text}" for title, text in lines)

    def _set_of_records(self, name: str) -> str:
        support = self.support
        text = f"{name}: one of {len(support.records[name])} in each episode"
        for measure in SCALED:
            row = support.names.get(f"{name}.scale_to.{measure}")
            if row is not None:
                low, high = support.low[row], support.high[row]
                span = f"{low:g}" if low == high else f"{low:g} to {high:g}"
                text += f", scaled to a {measure.replace('_', ' ')} of {span} in SI units"
        return text


@lru_cache(maxsize=256)
def _at_interval(plant: Plant, interval: float) -> Plant:
    # Without the excitation: hundreds of plants would hold as many copies of a record. Impulses
    # come between the intervals that they propagate.
    support = replace(plant.support, sample_interval=interval, excitation=np.zeros(FIRST))
    return replace(plant, support=support, model=plant.method.constants(support, plant.settings))
