"""The scene that a person writes: its parts with defaults, ranges and units, and its files."""

from mm_gym.scene.actuators import Actuation as Actuation
from mm_gym.scene.actuators import ForceActuator as ForceActuator
from mm_gym.scene.actuators import StretchActuator as StretchActuator
from mm_gym.scene.excitation import CloughPenzien as CloughPenzien
from mm_gym.scene.excitation import Harmonic as Harmonic
from mm_gym.scene.excitation import Impulse as Impulse
from mm_gym.scene.excitation import KanaiTajimi as KanaiTajimi
from mm_gym.scene.excitation import Noise as Noise
from mm_gym.scene.excitation import Recorded as Recorded
from mm_gym.scene.excitation import Sweep as Sweep
from mm_gym.scene.mechanics import Carriage as Carriage
from mm_gym.scene.mechanics import DryFriction as DryFriction
from mm_gym.scene.mechanics import FiniteStretch as FiniteStretch
from mm_gym.scene.mechanics import LinearSprings as LinearSprings
from mm_gym.scene.mechanics import NoInterface as NoInterface
from mm_gym.scene.mechanics import NoSprings as NoSprings
from mm_gym.scene.mechanics import SmallOnLarge as SmallOnLarge
from mm_gym.scene.mechanics import Sphere as Sphere
from mm_gym.scene.mechanics import Viscous as Viscous
from mm_gym.scene.part import Part as Part
from mm_gym.scene.scene import Control as Control
from mm_gym.scene.scene import Initial as Initial
from mm_gym.scene.scene import Objective as Objective
from mm_gym.scene.scene import Scene as Scene
from mm_gym.scene.scene import Solver as Solver
from mm_gym.scene.sensors import Sensors as Sensors
