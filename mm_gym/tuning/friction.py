"""The absorber with dry friction in place of a damper."""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# SciPy ships no types

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from mm_gym.analysis.springs import spring_stiffness
from mm_gym.analysis.values import linear_values
from mm_gym.errors import DesignError, suggest
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.tuning.friction_result import FrictionTuning
from mm_gym.tuning.friction_search import FrictionProblem
from mm_gym.tuning.optimum import excitation_of, require_fixed, require_resonance
from mm_gym.tuning.reach import obstacle, reach_of, springs_with
from mm_gym.tuning.steady_motion import motion_channels
from mm_gym.tuning.transfer import EXCITATIONS

if TYPE_CHECKING:
    from mm_gym.scene.scene import Scene


def friction_absorber(
    scene: Scene,
    *,
    amplitude: float | None = None,
    excitation: str | None = None,
    channel: str = "carriage_displacement",
) -> FrictionTuning:
    """Find the best normal force of dry friction, and the best stretch or stiffness of the springs.

    The function minimises the largest amplitude of the steady motion over all frequencies of a
    harmonic. The motion is not proportional to the harmonic, so the optimum belongs to one
    amplitude. Without creep, damping in slip and cubic springs the best friction force is
    proportional to this amplitude. The search begins with the first harmonic and ends with the
    simulated motion.

    Parameters
    ----------
    scene
        A scene whose interface is dry friction: its coefficients, reference velocity and damping in
        slip are kept. Its actuators, noise and ranges are left out.
    amplitude
        Amplitude of the harmonic [N, or m/s^2]; by default that of the scene's own harmonic.
    excitation
        "force" on the carriage or "ground"; by default as for `mm_gym.tuning.tune`.
    channel
        The minimised quantity: a displacement, a relative displacement or a velocity.

    Returns
    -------
    FrictionTuning
        The scene's own design and the best one that its springs reach, with their simulated curves.

    Raises
    ------
    DesignError
        If the interface is not dry friction, a name is unknown, the amplitude is missing or not
        greater than 0, the carriage has no mass or no stiffness, or a tuned parameter is drawn.

    Notes
    -----
    Ricciardelli and Vickery, *Tuned vibration absorbers with dry friction damping*, Earthquake Eng.
    Struct. Dyn. 28 (1999).
    """
    problem = _problem(scene, amplitude, excitation_of(scene, excitation), channel)
    own = problem.interface.normal_force or scene.sphere.mass * GRAVITY
    reach, reason = reach_of(scene), None
    start = problem.first(None if reach is None else problem.any_springs)
    if reach is not None:
        reason = obstacle(reach, start[1])
        # Springs without a limit approach the least stiffness, and never have it.
        least = max(reach.low, float(spring_stiffness(reach.longest, reach.k0)))
        limits = (least, reach.high) if isfinite(reach.high) else problem.any_springs
        best = problem.improved(start if reason is None else problem.first(limits), limits)
    else:
        best = problem.improved(start, None)
    frequencies = problem.band(*best)
    changes, stretch = springs_with(scene, best[1])
    return FrictionTuning(
        scene=scene,
        tuned=scene.replace(**{"interface.normal_force": best[0]}, **changes),
        excitation=problem.excitation,
        channel=channel,
        amplitude=problem.amplitude,
        frequencies=frequencies,
        before=problem.design(own, problem.values.k2, frequencies),
        after=problem.design(*best, frequencies),
        stretch=stretch,
        out_of_reach=reason,
    )


def _problem(
    scene: Scene, amplitude: float | None, excitation: str, channel: str
) -> FrictionProblem:
    """Return the problem; raise `DesignError` for what is none."""
    for name, value, allowed in (
        ("interface.kind", scene.interface.kind, ("dry_friction",)),
        ("excitation", excitation, EXCITATIONS),
        ("channel", channel, motion_channels()),
    ):
        if value not in allowed:
            msg = f"{name}: got {value!r}{suggest(value, allowed)}; allowed: {', '.join(allowed)}"
            raise DesignError(msg)
    require_fixed(scene, "interface.normal_force")
    require_resonance(linear_values(scene))
    if amplitude is None:
        harmonics = [part for part in scene.excitation if part.kind == "harmonic"]
        sizes = [abs(part.amplitude) for part in harmonics if part.target == excitation]
        if not sizes:
            msg = (
                f"amplitude: missing; no harmonic moves the {excitation} of the scene, and the "
                "best friction depends on its amplitude [N, or m/s^2 of the ground]"
            )
            raise DesignError(msg)
        amplitude = max(sizes)
    if not (isfinite(amplitude) and amplitude > 0.0):
        msg = f"amplitude: got {amplitude!r}; allowed: greater than 0"
        raise DesignError(msg)
    return FrictionProblem(scene, excitation, float(amplitude), channel)
