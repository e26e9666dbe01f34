"""What a scene states that does not fit its own motion: scales, noise and the control step."""

import numpy as np

from agents.control.scene import periods, plant_of
from agents.controllers.constant import uncontrolled
from agents.controllers.lqg import OF_ACTUATORS
from agents.rollout import Rollout
from agents.training.config import RunSettings
from agents.training.scales import LANES, SEED
from mm_gym import MovingMassVectorEnv, Scene

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
    plant = plant_of(scene)
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
    rollout = Rollout(env, uncontrolled(scene), seed=SEED)
    squares = [np.mean(step.observation.astype(np.float64) ** 2, axis=0) for step in rollout]
    sizes = np.sqrt(np.mean(squares, axis=0))[-len(plant.observed) :]
    found: list[str] = []
    for channel, size in zip(plant.observed, sizes, strict=True):
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
        print(
            *(f"warning: {line}\n" for line in misfits(settings.rewarded_scene())), sep="", end=""
        )
