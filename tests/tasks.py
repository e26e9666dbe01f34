"""Scenes of the registered tasks, for tests that begin from one."""

from mm_gym import load_scene
from mm_gym.tasks import ids

TASKS = {name: load_scene(name) for name in ids()}  # scene of each registered id

ACTIVE_MASS_DAMPER = TASKS["mm_gym/ActiveMassDamper-v0"]
CARRIAGE_FORCE = TASKS["mm_gym/CarriageForce-v0"]
CARRIAGE_FORCE_FRICTION = TASKS["mm_gym/CarriageForceFriction-v0"]
HYBRID = TASKS["mm_gym/Hybrid-v0"]
PRE_STRETCH = TASKS["mm_gym/PreStretch-v0"]
PRE_STRETCH_SHOCK = TASKS["mm_gym/PreStretchShock-v0"]
SEMI_ACTIVE_DAMPER = TASKS["mm_gym/SemiActiveDamper-v0"]
