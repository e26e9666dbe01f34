"""Tuned-mass dampers: optima in closed form, and by numerical optimisation for any linear scene."""

from mm_gym.analysis.tuning_closed_forms import CLOSED_FORMS, Absorber, ClosedForm, closed_form
from mm_gym.analysis.tuning_nonlinear import duffing_absorber
from mm_gym.analysis.tuning_scene import Design, Tuning, evaluate, stretch_for, tune
from mm_gym.analysis.tuning_search import CRITERIA
from mm_gym.analysis.tuning_transfer import CHANNELS, EXCITATIONS
from mm_gym.errors import DesignError, OutOfReachError

__all__ = [
    "CHANNELS",
    "CLOSED_FORMS",
    "CRITERIA",
    "EXCITATIONS",
    "Absorber",
    "ClosedForm",
    "Design",
    "DesignError",
    "OutOfReachError",
    "Tuning",
    "closed_form",
    "duffing_absorber",
    "evaluate",
    "stretch_for",
    "tune",
]
