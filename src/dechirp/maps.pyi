# Written by tests/test_api.py.

from dechirp.processing.maps import range_doppler_map as range_doppler_map
from dechirp.processing.maps import range_doppler_spectrum as range_doppler_spectrum
from dechirp.processing.maps import range_spectrum as range_spectrum
