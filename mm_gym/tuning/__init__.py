"""Tuned-mass dampers: optima in closed form, and by numerical optimisation for any linear scene."""

from mm_gym.errors import DesignError as DesignError
from mm_gym.errors import OutOfReachError as OutOfReachError
from mm_gym.tuning.closed_forms import CLOSED_FORMS as CLOSED_FORMS
from mm_gym.tuning.closed_forms import Absorber as Absorber
from mm_gym.tuning.closed_forms import ClosedForm as ClosedForm
from mm_gym.tuning.closed_forms import closed_form as closed_form
from mm_gym.tuning.closed_forms import duffing_absorber as duffing_absorber
from mm_gym.tuning.friction import friction_absorber as friction_absorber
from mm_gym.tuning.friction import lanchester_friction as lanchester_friction
from mm_gym.tuning.optimum import CRITERIA as CRITERIA
from mm_gym.tuning.optimum import evaluate as evaluate
from mm_gym.tuning.optimum import tune as tune
from mm_gym.tuning.reach import stretch_for as stretch_for
from mm_gym.tuning.result import Design as Design
from mm_gym.tuning.result import FrictionDesign as FrictionDesign
from mm_gym.tuning.result import FrictionTuning as FrictionTuning
from mm_gym.tuning.result import Tuning as Tuning
from mm_gym.tuning.transfer import CHANNELS as CHANNELS
from mm_gym.tuning.transfer import EXCITATIONS as EXCITATIONS
