"""Recorded motions in files: PEER's AT2, and columns of text.

Records are read strictly: the first line that does not fit is refused, because nobody would notice
a sample that is misread or missing.
"""

from mm_gym.records.options import ACCELERATION_UNITS as ACCELERATION_UNITS
from mm_gym.records.options import FORCE_UNITS as FORCE_UNITS
from mm_gym.records.options import LARGEST as LARGEST
from mm_gym.records.options import UNITS as UNITS
from mm_gym.records.record import Record as Record
from mm_gym.records.record import read_record as read_record
from mm_gym.records.record import resample as resample
