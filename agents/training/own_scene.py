"""What follows from a scene of one's own: what does not fit in it, and settings of learning.

A task's own scale, time step and base were chosen when its settings were found. Of another scene
nothing is known, so that they are measured: rewards of any size make the value function useless,
exploration at a third of the force drowns a controller that uses a twentieth of it, and a discount
of 0.97 forgets within a sixth of a period where a period has two hundred control steps.
"""

import os
import sys

import numpy as np

from agents.control.kalman_filter import OF_ACTUATORS
from agents.control.scene import periods, plant_of
from agents.controllers.constant import uncontrolled
from agents.training.config import PPOSettings, RunSettings, TrainSettings
from agents.training.parts import NO_BASE, base_controller, best_controller
from agents.training.runs import Run
from agents.training.scales import LEAST, sizes_under
from mm_gym import Scene

FITS = 0.01, 100.0  # least and largest root mean square of an observed channel without control
STEPS = 4.0, 1000.0  # fewest and most control steps in a period

SCALED_BY = {
    "displacement": "objective.displacement_scale",
    "offset": "objective.stroke_scale",
    "velocity": "objective.velocity_scale",
    "acceleration": "objective.velocity_scale",
    "force": "objective.displacement_scale",
}
"""By the last word of a channel's name: the field that its scale follows from."""


def misfits(scene: Scene) -> list[str]:
    """Return what does not fit the motion without control, a line each; nothing where all does."""
    plant, found = plant_of(scene), list[str]()
    (sizes,) = sizes_under(scene, uncontrolled(scene), lambda one: [one.observation.astype(float)])
    for channel, size in zip(plant.observed, sizes[-len(plant.observed) :], strict=True):
        if channel.name in OF_ACTUATORS:
            continue
        noise = channel.noise * channel.factor
        motion = float(np.sqrt(max(size**2 - noise**2, 0.0)))
        if not FITS[0] <= motion <= FITS[1]:
            field = SCALED_BY[channel.name.rpartition("_")[2]]
            found.append(
                f"{field}: without control {channel.name} is {motion / channel.factor:.2g} "
                f"{channel.unit} (root mean square), {motion:.2g} times its scale; "
                f"allowed: {FITS[0]:g} to {FITS[1]:g} times"
            )
        if noise > motion:
            found.append(
                f"sensors.noise.{channel.name}: got {channel.noise:g} {channel.unit}; the motion "
                f"without control is smaller, {motion / channel.factor:.2g} {channel.unit}"
            )
    steps = periods(scene)
    if steps.size:
        least, most = steps.min(), steps.max()
        if least < STEPS[0] or most > STEPS[1]:
            found.append(
                f"control.time_step: got {scene.control.time_step:g} s, {least:.3g} to {most:.3g} "
                f"steps in the periods of the modes; allowed: {STEPS[0]:g} to {STEPS[1]:g}"
            )
    return found


def print_misfits(settings: RunSettings) -> None:
    """Print the same as warnings, if the scene is one's own."""
    if settings.scene is not None:
        for line in misfits(settings.rewarded_scene()):
            print(f"warning: {line}")


PERIODS = 2.0  # of the slowest mode that are looked ahead
DISCOUNTS = 0.9, 0.998  # least and largest
EXPLORED = 0.5  # exploration's size over that of the base's actions
QUIET, LOUD = 0.01, 0.6  # least and largest standard deviation of the exploration


def for_own_scene(settings: TrainSettings, run: Run) -> TrainSettings:
    """Return settings with what is not asked for measured, if the scene is one's own.

    A run that goes on keeps the base of its record, and what was measured for it.
    """
    if settings.scene is None:
        return settings
    scene, chosen, base = settings.rewarded_scene(), settings.chosen, settings.base
    before = run.read()["settings"] if os.path.lexists(run.record) else {}
    if base is None and before:
        base = before.get("base") or NO_BASE
    if base is None:  # the training seems to hang otherwise
        told = "looking for the best controller to train around, for a minute or two"
        print(f"{told}; --base NAME or --base none saves it", file=sys.stderr)
        base = best_controller(scene, plans=False).name
    measured = {"discount", "initial_log_std"} - chosen.model_fields_set
    known: dict[str, object] = before.get(settings.algorithm) or {}
    changes = {name: known[name] for name in measured & known.keys()}
    if "discount" in measured - known.keys():
        changes["discount"] = discount_of(scene)
    explores = isinstance(chosen, PPOSettings) and "initial_log_std" in measured - known.keys()
    if explores and base != NO_BASE:
        (sizes,) = sizes_under(scene, base_controller(scene, base), lambda one: [one.action])
        size = max(LEAST, np.sqrt(np.mean(sizes**2)))
        spread = np.clip(EXPLORED * size / settings.authority, QUIET, LOUD)
        changes["initial_log_std"] = round(float(np.log(spread)), 3)
    return settings.model_copy(
        update={
            "base": base,
            "normalise_observations": True,
            "normalise_rewards": True,
            settings.algorithm: chosen.model_copy(update=changes),
        }
    )


def discount_of(scene: Scene) -> float:
    """Return the discount that looks ahead for some periods of the slowest mode."""
    steps = periods(scene)
    if not steps.size:
        return DISCOUNTS[1]
    return round(float(np.clip(1.0 - 1.0 / (PERIODS * steps.max()), *DISCOUNTS)), 4)
