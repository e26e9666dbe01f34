"""Analysis of a scene: modes, frequency response, asymptotic offset and critical velocity.

And of a ground motion: its response spectrum.
"""

from mm_gym.analysis.asymptotes import asymptotic_offset as asymptotic_offset
from mm_gym.analysis.asymptotes import bifurcation as bifurcation
from mm_gym.analysis.asymptotes import critical_reference_velocity as critical_reference_velocity
from mm_gym.analysis.linear import FrequencyResponse as FrequencyResponse
from mm_gym.analysis.linear import Modes as Modes
from mm_gym.analysis.linear import frequency_response as frequency_response
from mm_gym.analysis.linear import modes as modes
from mm_gym.analysis.spectrum import ResponseSpectrum as ResponseSpectrum
from mm_gym.analysis.spectrum import response_spectrum as response_spectrum
from mm_gym.analysis.springs import spring_energy as spring_energy
from mm_gym.analysis.springs import spring_force as spring_force
from mm_gym.analysis.springs import spring_stiffness as spring_stiffness
from mm_gym.analysis.springs import stretch_for_stiffness as stretch_for_stiffness
