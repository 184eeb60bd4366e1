# Written by tests/test_api.py.

from dechirp.theory.link_budget import beat_frequency as beat_frequency
from dechirp.theory.link_budget import max_range as max_range
from dechirp.theory.link_budget import noise_power as noise_power
from dechirp.theory.link_budget import range_from_beat as range_from_beat
from dechirp.theory.link_budget import range_resolution as range_resolution
from dechirp.theory.link_budget import received_power as received_power
from dechirp.theory.link_budget import sample_snr as sample_snr
from dechirp.theory.link_budget import ula_beamwidth as ula_beamwidth
from dechirp.theory.link_budget import unambiguous_range as unambiguous_range
from dechirp.theory.link_budget import unambiguous_velocity as unambiguous_velocity
from dechirp.theory.link_budget import velocity_resolution as velocity_resolution
