# Written by tests/test_api.py.

from dechirp.radar.multiplexing.bpm import Bpm as Bpm
from dechirp.radar.multiplexing.ddma import Ddma as Ddma
from dechirp.radar.multiplexing.phase_code import PhaseCode as PhaseCode
from dechirp.radar.multiplexing.tdm import Tdm as Tdm
