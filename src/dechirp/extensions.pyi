# Written by tests/test_api.py.

from dechirp.core.checks import check_non_negative_fields as check_non_negative_fields
from dechirp.core.checks import check_positive_fields as check_positive_fields
from dechirp.core.values import frozen_dataclass as frozen_dataclass
from dechirp.evaluation.score.base import Score as Score
from dechirp.processing.angle.base import DirectionEstimator as DirectionEstimator
from dechirp.processing.angle.base import SpectralEstimator as SpectralEstimator
from dechirp.processing.cfar.base import NoiseEstimator as NoiseEstimator
from dechirp.processing.cfar.base import TrainingWindow as TrainingWindow
from dechirp.processing.cfar.window_means import scaled_window_means as scaled_window_means
from dechirp.processing.mitigation.base import Mitigation as Mitigation
from dechirp.radar.devices.base import Device as Device
from dechirp.radar.modulations.base import Modulation as Modulation
from dechirp.radar.multiplexing.base import Multiplexing as Multiplexing
from dechirp.radar.patterns.base import Pattern as Pattern
from dechirp.recordings.description import parse_radar as parse_radar
from dechirp.recordings.readers.base import Contents as Contents
from dechirp.recordings.readers.base import Format as Format
from dechirp.recordings.readers.base import MatchQuality as MatchQuality
from dechirp.recordings.readers.base import RecordingHints as RecordingHints
from dechirp.recordings.writers.base import Writer as Writer
from dechirp.scene.bodies.base import AspectBody as AspectBody
from dechirp.scene.bodies.base import Body as Body
from dechirp.simulation.impairments.base import Oscillator as Oscillator
from dechirp.simulation.impairments.base import Preset as Preset
from dechirp.simulation.impairments.base import Propagation as Propagation
from dechirp.simulation.impairments.base import Receiver as Receiver
