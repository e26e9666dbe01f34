"""Structures from the literature, each with its source and a device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mm_gym.errors import StructureError, check_name
from mm_gym.scene.scene import Scene
from mm_gym.structure.structure import Reduction, Structure
from mm_gym.tuning.closed_forms import closed_form


@dataclass(frozen=True, eq=False)
class Example:
    """A structure from the literature with a device on it.

    Attributes
    ----------
    source
        Source of its numbers, and which numbers are assumed.
    structure, device, mode
        The structure, the device's degree of freedom and the mode.
    mass
        Mass of the device [kg].
    fields
        Further arguments of `Reduction.scene`.
    """

    source: str
    structure: Structure
    device: int
    mass: float
    fields: dict[str, Any]
    mode: int = 1

    @property
    def reduction(self) -> Reduction:
        """The mode as a carriage."""
        return self.structure.reduce(self.device, self.mode)

    def scene(self, **fields: object) -> Scene:
        """Return the scene; further fields, such as ground, are those of `Reduction.scene`."""
        arguments: dict[str, Any] = {"mass": self.mass, **self.fields, **fields}
        return self.reduction.scene(**arguments)


def example(name: str) -> Example:
    """Return the example with a name from `EXAMPLES`.

    Raises
    ------
    StructureError
        If there is no such example.
    """
    check_name("example", name, EXAMPLES, StructureError)
    return EXAMPLES[name]()


def _quarter_car() -> Example:
    return Example(
        "Robust Control Toolbox, The MathWorks, example Robust Control of Active Suspension: body "
        "300 kg, wheel 60 kg, suspension 16 kN/m and 1000 N s/m, tyre 190 kN/m. The tyre is not "
        "damped. The wheel is the carriage, the body the device: nothing is left out.",
        Structure([[60.0]], [[190e3]], 0.0),
        device=1,
        mass=300.0,
        fields={
            "interface": {"kind": "viscous", "damping": 1000.0},
            "springs": {"kind": "linear", "stiffness": 16e3},
            "control": {"time_step": 0.005, "steps": 800},
        },
    )


def _three_storeys() -> Example:
    structure = Structure(
        98.3 * np.eye(3),
        [[12.0e5, -6.84e5, 0.0], [-6.84e5, 13.7e5, -6.84e5], [0.0, -6.84e5, 6.84e5]],
        [[175.0, -50.0, 0.0], [-50.0, 100.0, -50.0], [0.0, -50.0, 50.0]],
        storeys=True,
    )
    return _with_absorber(
        "Dyke, Spencer, Sain and Carlson, Modeling and control of magnetorheological dampers for "
        "seismic response reduction, Smart Materials and Structures 5 (1996): M, C and K of the "
        "laboratory frame. The absorber is ours: 2 % of the generalised mass, on the top floor.",
        structure,
        0.02,
        {"time_step": 0.005, "steps": 2000},
    )


def _five_storeys() -> Example:
    return _with_absorber(
        "Chopra, Dynamics of Structures, 5th ed. in SI units (2020), section 13.2.6: uniform shear "
        "frame of 45 Mg a floor and 54.82 kN/cm a storey, 5 % damping in all modes. The absorber "
        "is ours: 5 % of the generalised mass, on the top floor.",
        Structure.of_storeys([45e3] * 5, [5.482e6] * 5, 0.05),
        0.05,
        {"time_step": 0.02, "steps": 1500},
    )


def _with_absorber(source: str, structure: Structure, ratio: float, control: Any) -> Example:  # noqa: ANN401 - a table of a scene
    """Return a structure with an absorber on its top floor, tuned to the first mode."""
    mass = ratio * structure.reduce(structure.count).mass
    absorber = closed_form("h2_ground_displacement", ratio)
    return Example(
        source, structure, structure.count, mass, {"absorber": absorber, "control": control}
    )


TOWER_FLOORS, TOWER_MASS = 76, 153e6


def _tower() -> Example:
    structure = _cantilever(TOWER_FLOORS, TOWER_MASS, 2.0 * np.pi * 0.16, 0.01)
    mass, form = 500e3, "h2_force_displacement"
    absorber = closed_form(form, mass / structure.reduce(TOWER_FLOORS).mass)
    return Example(
        "Yang, Agrawal, Samali and Wu, Benchmark problem for response control of wind-excited tall "
        "buildings, J. Eng. Mech. 130 (2004): 76 floors, 306 m, 153,000 t, first mode 0.16 Hz, "
        "damping 1 %, damper of 500 t on top. Mass and stiffness are spread evenly over the height "
        "here, so that only the first mode is that of the benchmark, and its generalised mass is a "
        "quarter of the tower's; the damper is tuned by a closed form.",
        structure,
        TOWER_FLOORS,
        mass,
        {"absorber": absorber, "control": {"time_step": 0.1, "steps": 6000}},
    )


def _cantilever(floors: int, mass: float, frequency: float, damping: float) -> Structure:
    """Return a uniform bending cantilever: floors' displacements, their rotations condensed."""
    height = np.arange(1, floors + 1) / floors
    low, high = np.minimum.outer(height, height), np.maximum.outer(height, height)
    flexibility = low**2 * (3.0 * high - low) / 6.0  # of a unit height and bending stiffness
    masses = np.full(floors, mass / floors)
    masses[-1] *= 0.5
    stiffness = np.linalg.inv(flexibility)
    bare = Structure(np.diag(masses), 0.5 * (stiffness + stiffness.T), 0.0)
    factor = (frequency / bare.frequencies[0]) ** 2
    return Structure(bare.mass, factor * bare.stiffness, damping, storeys=True)


EXAMPLES: dict[str, Callable[[], Example]] = {
    "quarter_car": _quarter_car,
    "three_storeys": _three_storeys,
    "five_storeys": _five_storeys,
    "tower": _tower,
}
"""Name -> function that makes the example."""
