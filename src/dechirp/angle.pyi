# Written by tests/test_api.py.

from dechirp.processing.angle.bartlett import Bartlett as Bartlett
from dechirp.processing.angle.capon import Capon as Capon
from dechirp.processing.angle.covariance import Smoothing as Smoothing
from dechirp.processing.angle.covariance_snapshots import snapshots_from_covariance as snapshots_from_covariance
from dechirp.processing.angle.esprit import Esprit as Esprit
from dechirp.processing.angle.fft import Fft as Fft
from dechirp.processing.angle.iterative_adaptive import IterativeAdaptive as IterativeAdaptive
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood as MaximumLikelihood
from dechirp.processing.angle.monopulse import Monopulse as Monopulse
from dechirp.processing.angle.music import Music as Music
from dechirp.processing.angle.plain_arrays import bartlett as bartlett
from dechirp.processing.angle.plain_arrays import capon as capon
from dechirp.processing.angle.plain_arrays import direction_spectrum as direction_spectrum
from dechirp.processing.angle.plain_arrays import esprit as esprit
from dechirp.processing.angle.plain_arrays import estimate_directions as estimate_directions
from dechirp.processing.angle.plain_arrays import fft as fft
from dechirp.processing.angle.plain_arrays import iterative_adaptive as iterative_adaptive
from dechirp.processing.angle.plain_arrays import maximum_likelihood as maximum_likelihood
from dechirp.processing.angle.plain_arrays import monopulse as monopulse
from dechirp.processing.angle.plain_arrays import music as music
from dechirp.processing.angle.plain_arrays import root_music as root_music
from dechirp.processing.angle.root_music import RootMusic as RootMusic
