"""Carriages with two wells, with barriers, and without a stable place to rest."""

from mm_gym import Scene

PLACE = 0.01  # wells or barrier at x1 = +-10 mm

BISTABLE = Scene(
    carriage={"linear_coefficient": -1.0, "cubic_coefficient": PLACE**-2},
    initial={"carriage_displacement": 0.002, "sphere_offset": 0.02},
)
SOFTENING = BISTABLE.replace(
    **{"carriage.linear_coefficient": 1.0, "carriage.cubic_coefficient": -(PLACE**-2)}
)
UNSTABLE = BISTABLE.replace(**{"carriage.cubic_coefficient": 0.0})
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.3,
    "reference_velocity": 0.1,
}
