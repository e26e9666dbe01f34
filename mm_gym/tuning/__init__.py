"""Tuned-mass dampers: optima in closed form, and by numerical optimisation for any linear scene."""

from mm_gym.errors import DesignError, OutOfReachError
from mm_gym.tuning.closed_forms import (
    CLOSED_FORMS,
    Absorber,
    ClosedForm,
    closed_form,
    duffing_absorber,
)
from mm_gym.tuning.friction import friction_absorber, lanchester_friction
from mm_gym.tuning.optimum import CRITERIA, evaluate, tune
from mm_gym.tuning.reach import stretch_for
from mm_gym.tuning.result import Design, FrictionDesign, FrictionTuning, Tuning
from mm_gym.tuning.transfer import CHANNELS, EXCITATIONS

__all__ = [
    "CHANNELS",
    "CLOSED_FORMS",
    "CRITERIA",
    "EXCITATIONS",
    "Absorber",
    "ClosedForm",
    "Design",
    "DesignError",
    "FrictionDesign",
    "FrictionTuning",
    "OutOfReachError",
    "Tuning",
    "closed_form",
    "duffing_absorber",
    "evaluate",
    "friction_absorber",
    "lanchester_friction",
    "stretch_for",
    "tune",
]
