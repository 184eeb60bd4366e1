# Written by tests/test_api.py.

from dechirp.radar.modulations.frequency_shift_keying import FrequencyShiftKeying as FrequencyShiftKeying
from dechirp.radar.modulations.staggered import Staggered as Staggered
from dechirp.radar.modulations.triangular import Triangular as Triangular
