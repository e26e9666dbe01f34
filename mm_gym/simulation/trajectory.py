"""A trajectory: what a simulation returns."""

# pyright: reportUnknownMemberType=false
# matplotlib's signatures are typed in part only

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.arrays import Array
from mm_gym.drawing import ACTUATORS, COLOURS, STYLES, drawn, legend_below, panels
from mm_gym.errors import SimulationError, check_name
from mm_gym.files import write_csv
from mm_gym.lanes import layout
from mm_gym.law.springs import LINEAR
from mm_gym.simulation.energy.work import Work, mechanical_energy, work_of
from mm_gym.simulation.recording import Place, Recording, excitation
from mm_gym.simulation.response import (
    acceleration,
    base_force,
    damped,
    interface_energy,
    root_mean_square,
    spring_force,
)
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXCITATION = ("disturbance [N]", "ground [m/s²]")  # labels of the excitation's axes


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The states of a simulation at its instants, with actions, excitation and energies.

    Attributes
    ----------
    time
        (n,) [s].
    state
        (n, 4): x1, x2 [m], v1, v2 [m/s], ground frame.
    interface_state
        (n, k): the interface's own k states: z [-] of Bouc-Wen, y and z [m] of a magnetorheological
        damper.
    action
        (n, k): the values that the actuators apply from each instant on, in the order of
        `actuators`.
    applied
        (n, 2): force [N] and stretch [-], whether actuated or not; (n, 3) if the damping [N s/m] or
        voltage [V] is actuated, which is then the last column.
    actuators
        Names of the action's columns.
    parameters
        (rows,): the lane's parameters as they were drawn.
    recording, place
        The simulated control steps, from which `work` is computed, and the position of the instants
        in them.
    """

    time: Array
    state: Array
    interface_state: Array
    action: Array
    applied: Array
    actuators: tuple[str, ...]
    parameters: Array
    recording: Recording
    place: Place

    @property
    def records(self) -> dict[str, str]:
        """Name of each set of records, as "excitation.0" -> the file that this episode has."""
        return self.recording.plant.records_of(self.parameters)

    @cached_property
    def excitation(self) -> Array:
        """Disturbing force [N] and acceleration of the ground [m/s^2], (n, 2)."""
        return excitation(self.recording, self.place)

    @cached_property
    def acceleration(self) -> Array:
        """Absolute accelerations (n, 2) [m/s^2] of carriage and sphere.

        They include the acceleration of the ground. Impulses are left out, because they change the
        velocities instantaneously.
        """
        support, states = self.recording.plant.support, self._states
        return acceleration(support, self.parameters, states, self.applied, self.excitation[:, 0])

    @property
    def _states(self) -> Array:
        """The states (n, 4), with the interface's own behind them."""
        return np.hstack([self.state, self.interface_state])

    @cached_property
    def base_force(self) -> Array:
        """Base shear, the force (n,) [N] on the base, positive in the direction of x1.

        It is the force of the carriage's spring and damper, plus the reaction to the control force
        if its actuator stands on the base.
        """
        support = self.recording.plant.support
        return base_force(support, self.parameters, self.state, self.applied)

    def channel(self, name: str) -> Array:
        """Return a channel (n,) by its name, in SI units, without noise and delay.

        Raises
        ------
        SimulationError
            If there is no such channel, or the scene has no actuator for it.
        """
        check_name("channel", name, CHANNELS, SimulationError)
        channel = CHANNELS[name]
        if channel.row in range(4):
            values = self.state[:, channel.row]
            subtracted = channel.subtracted
            return values - self.state[:, subtracted] if subtracted in range(4) else values
        if name == "stretch" and self.parameters[layout.STRETCH] == LINEAR:
            msg = "channel: got 'stretch'; springs.kind = 'linear' has no stretch"
            raise SimulationError(msg)
        if name in ("damping", "voltage"):
            if name not in self.actuators:
                msg = f"channel: {name!r} needs an actuator; set actuation.{name}"
                raise SimulationError(msg)
            return self.applied[:, 2]
        if name in ("applied_force", "stretch"):
            return self.applied[:, int(name == "stretch")]
        if name == "spring_force":
            support = self.recording.plant.support
            return spring_force(support, self.parameters, self._states, self.applied[:, 1])
        if name in ("disturbance_force", "ground_acceleration"):
            return self.excitation[:, int(name == "ground_acceleration")]
        return self.acceleration[:, int(name == "sphere_acceleration")]

    def peak(self, name: str) -> float:
        """Return the largest magnitude of a channel at the instants."""
        return float(abs(self.channel(name)).max())

    def rms(self, name: str) -> float:
        """Return the root mean square of a channel over time."""
        return root_mean_square(self.time, self.channel(name))

    @cached_property
    def energy(self) -> Array:
        """Kinetic and elastic energy (n,) [J], with the stretch and voltage of each instant."""
        energy = mechanical_energy(self.parameters, self.state, self.applied[:, 1])
        support = self.recording.plant.support
        p = damped(support, self.parameters, self.applied)
        return energy + interface_energy(support, p, self._states)

    @cached_property
    def work(self) -> Work:
        """Work done since the first instant, by kind; see `Work`.

        It is computed at the first access, from the states at the control steps.

        Notes
        -----
        The integrals follow the exact motion from the start of each control step. If the method has
        a finite order, the energy balance therefore shows its error.
        """
        return work_of(self.recording, self.place, self._states, self.energy)

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write time, state, action and excitation as columns with units; all digits are kept."""
        header = ["time [s]", "x1 [m]", "x2 [m]", "v1 [m/s]", "v2 [m/s]"]
        header += [ACTUATORS[name] for name in self.actuators]
        header += ["disturbance [N]", "ground acceleration [m/s^2]"]
        write_csv(path, header, [self.time, *self.state.T, *self.action.T, *self.excitation.T])

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw displacements, velocities, excitation, applied values and energy over time.

        Parameters
        ----------
        path
            Where to write a PNG; the file is written whole.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        gymnasium.error.DependencyNotInstalled
            Without matplotlib (extra: plot).
        """
        return drawn(_draw, self, path)


def _draw(trajectory: Trajectory) -> Figure:
    """Return displacements, velocities, excitation, what was applied and the energy over time."""
    excited = [k for k in range(2) if trajectory.excitation[:, k].any()]
    count = 3 + len(excited) + len(trajectory.actuators)
    figure, axes = panels(1.2 * count + 0.6, count, 1, sharex="all")
    time, (x1, x2, v1, v2) = trajectory.time, trajectory.state.T
    rows = (
        ("displacement [mm]", 1e3, (x1, x2, x2 - x1)),
        ("velocity [m/s]", 1.0, (v1, v2, v2 - v1)),
    )
    names = ("carriage", "sphere", "sphere relative to carriage")
    for panel, (label, factor, curves) in zip(axes, rows, strict=False):
        for i, curve in enumerate(curves):
            panel.plot(time, factor * curve, STYLES[i], color=COLOURS[i], label=names[i])
        panel.set_ylabel(label)
    for panel, k in zip(axes[2:], excited, strict=False):
        panel.plot(time, trajectory.excitation[:, k], color=COLOURS[6])
        panel.set_ylabel(EXCITATION[k])
    for k, name in enumerate(trajectory.actuators):
        panel = axes[2 + len(excited) + k]
        panel.plot(time, trajectory.action[:, k], color=COLOURS[6], drawstyle="steps-post")
        panel.set_ylabel(ACTUATORS[name])
    axes[-1].plot(time, 1e3 * trajectory.energy, color=COLOURS[6])
    axes[-1].set(xlabel="time [s]", ylabel="energy [mJ]")
    figure.align_ylabels(axes)
    legend_below(figure, axes[0], 3)
    return figure
