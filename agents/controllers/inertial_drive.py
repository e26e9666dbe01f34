"""The inertial drive: it moves a sphere that dry friction holds, by pushing fast and returning."""

from collections.abc import Mapping

import numpy as np
from scipy.linalg import expm

from agents.control.actuators import Command
from agents.control.controller import Acted, Memory
from agents.control.scene import nominal, plant_of
from agents.controllers.adjustable import Adjustable
from agents.controllers.lqr import LQR
from agents.controllers.registry import Free, Tunable, without_weight
from mm_gym import Scene
from mm_gym.arrays import Array

HOLD, PUSH, RETURN = 0, 1, 2

REFERENCE = "interface.reference_velocity"

OF_DESIGN = "hold_effort", "hold_velocity"
"""Free numbers of the LQR's design: they cannot change in a control step."""


class InertialDrive(Adjustable):
    """Push the carriage fast towards the sphere, and return it without slip, until that is centred.

    While the sphere sticks, nothing changes where it comes to rest, x2 - x1 + m2 v2 / c_s: the
    force can only still the carriage, by the LQR. In a slip faster than v_r friction is less than
    c_s times the slip, so the sphere stays behind. A fast push under it moves it by nearly the
    stroke; the return below v_r takes it along. Push and return take turns between two
    displacements of the carriage until the sphere would come to rest close to the middle. Both
    follow a velocity, by the force that reaches it in one control step. Such drives move stages by
    nanometres; Zesch, Buechi, Codourey and Siegwart, *Inertial drives for micro- and
    nanorobots*, SPIE 2593 (1995).

    Notes
    -----
    A mirrored state gives the mirrored force.
    """

    name, inputs = "inertial drive", 5

    def __init__(self, scene: Scene, numbers: Mapping[str, float]) -> None:
        free = free_numbers(scene).items()
        super().__init__({name: one for name, one in free if name not in OF_DESIGN}, numbers)
        self.length = scene.objective.displacement_scale
        self.speed = nominal(scene, REFERENCE)
        self.momentum = 1.0 / plant_of(scene).linear()[0][3, 2]  # m2 / c_s [s], of stick
        self.static = nominal(scene, "sphere.mass") * self.speed / self.momentum
        self.kinetic = self.static * nominal(scene, "interface.kinetic_coefficient")
        self.kinetic /= nominal(scene, "interface.static_coefficient")
        self.growth = nominal(scene, "interface.slip_damping")
        self.limit, self.step = Command(scene, "force").high, scene.control.time_step
        mass, damping, stiffness, linear = (
            nominal(scene, f"carriage.{one}")
            for one in ("mass", "damping", "stiffness", "linear_coefficient")
        )
        a = np.zeros((3, 3))
        a[0, 1] = 1.0
        a[1] = -stiffness * linear / mass, -damping / mass, 1.0 / mass
        self.moved = expm(a * self.step)[:2]
        held = scene.replace(
            **{
                "objective.stroke_weight": 0.0,
                "objective.effort_weight": scene.objective.effort_weight * numbers["hold_effort"],
                "objective.velocity_weight": scene.objective.velocity_weight
                * numbers["hold_velocity"],
            }
        )
        self.hold = LQR(held)

    def begin(self, lanes: int) -> Memory:
        return {"mode": np.full(lanes, HOLD), "side": np.zeros(lanes)}

    def situation(self, memory: Memory, state: Array) -> Array:
        """Return x1, the rest's distance, v1 and v2 towards a side, and the last step's mode.

        The side is that of the last drive, and before any that of the sphere.
        """
        x1, x2, v1, v2 = state.T
        rest = x2 - x1 + self.momentum * v2
        side = np.where(memory["side"] == 0.0, np.sign(rest), memory["side"])
        scales = [self.length] * 2 + [self.speed] * 2
        towards = side[:, None] * np.column_stack([x1, rest, v1, v2]) / scales
        return np.column_stack([towards, memory["mode"] - PUSH])

    def friction(self, slip: Array) -> Array:
        """Return the friction force [N] on the carriage at slips v2 - v1 [m/s]."""
        size = np.abs(slip)
        sliding = self.kinetic + self.growth * (size - self.speed)
        sticking = self.static / self.speed * size
        return np.sign(slip) * np.where(size <= self.speed, sticking, sliding)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        n, (x1, x2, v1, v2) = self.numbers, state.T
        rest = x2 - x1 + self.momentum * v2
        mode, side = memory["mode"], memory["side"]
        far = np.abs(rest)
        driven = far > np.where(mode == HOLD, n["band"] * n["hysteresis"], n["band"])
        turned = driven & ((mode == HOLD) | (side != np.sign(rest)))
        side = np.where(turned, np.sign(rest), side)
        towards = side * (x1 + n["lead"] * self.step * v1)
        mode = np.where(turned & (mode == HOLD), RETURN, mode)
        over = towards > n["reach"] + n["reach_growth"] * far
        back = towards < -n["retreat"] - n["retreat_growth"] * far
        mode = np.where(over, RETURN, np.where(back, PUSH, mode))
        mode = np.where(driven, mode, HOLD)

        fast = n["push"] + n["push_growth"] * far
        wanted = side * np.where(mode == PUSH, fast, -n["return"] * self.speed)
        gain = np.where(mode == PUSH, n["push_gain"], n["return_gain"])
        (_, (of_x, of_v, of_u)), friction = self.moved, self.friction(v2 - v1)
        coasting = of_x * x1 + of_v * v1 + of_u * friction
        drive = gain * (wanted - coasting) / of_u / self.limit
        held, _ = self.hold.action({}, state, applied)
        return np.where(mode == HOLD, held[:, 0], drive)[:, None], {"mode": mode, "side": side}


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return the free numbers, from the scene's scales.

    Lengths [m]: "band" in which the sphere is left, "reach" and "retreat" of the carriage. Speeds
    [m/s]: "push". Per distance [-, 1/s]: "reach_growth", "retreat_growth", "push_growth". The
    others are factors: "hysteresis" of the band, "return" of v_r, "push_gain" and "return_gain" of
    the force, "lead" of the control step, "hold_effort" and "hold_velocity" of the weights.
    """
    length, speed = scene.objective.displacement_scale, nominal(scene, REFERENCE)
    return {
        "band": Free(0.1 * length, 0.5),
        "hysteresis": Free(1.2, 0.2, low=1.0),
        "reach": Free(0.3 * length, 0.1 * length, ratio=False),
        "reach_growth": Free(0.2, 0.1, ratio=False),
        "retreat": Free(0.2 * length, 0.1 * length, ratio=False),
        "retreat_growth": Free(0.1, 0.1, ratio=False),
        "push": Free(3.0 * speed, 0.5),
        "push_growth": Free(0.0, speed / length, ratio=False),
        "return": Free(0.7, 0.2),
        "push_gain": Free(1.0, 0.2),
        "return_gain": Free(1.0, 0.2),
        "lead": Free(0.5, 0.3, ratio=False),
        "hold_effort": Free(1.0, 1.0),
        "hold_velocity": Free(1.0, 0.5),
    }


def _refused(scene: Scene) -> str | None:
    if scene.interface.kind != "dry_friction":
        return f"which drives by dry friction; interface.kind: got {scene.interface.kind!r}"
    if scene.springs.kind != "none":
        return f"which moves a sphere without springs; springs.kind: got {scene.springs.kind!r}"
    if scene.actuation.is_between:
        return "which pushes against the ground; actuation.force.between: got 'masses'"
    return without_weight(scene)


INERTIAL_DRIVE = Tunable("inertial-drive", free_numbers, InertialDrive)

ENTRIES = (INERTIAL_DRIVE.entry(("force",), 12, refuses=_refused),)
