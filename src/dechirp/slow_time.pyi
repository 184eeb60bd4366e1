# Written by tests/test_api.py.

from dechirp.processing.slow_time import displacement as displacement
from dechirp.processing.slow_time import displacement_spectrum as displacement_spectrum
from dechirp.processing.slow_time import frame_means as frame_means
from dechirp.processing.slow_time import range_traces as range_traces
from dechirp.processing.slow_time import range_track as range_track
from dechirp.processing.slow_time import slow_time as slow_time
from dechirp.processing.slow_time import strongest_oscillation as strongest_oscillation
