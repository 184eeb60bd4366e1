"""The law of a chain's false alarms: in a cell, and in a whole frame."""

from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.chain import Chain
from dechirp.process.maps import left_by
from dechirp.process.spectrum import Transform, independent_rows
from dechirp.radar.radar import Radar
from dechirp.theory.clumps import Neighbours, highest_share

# Places of the cell under test for which a law of an offset is found; between them it is smooth.
_PLACES = 5
_RAREST = 1e-60
# False alarms in a ring of training cells, above which they come together: where the training
# cells of one are low by chance those beside it train on them too.
_MOST_IN_A_RING = 0.01


def in_a_cell(radar: Radar, chain: Chain) -> float:
    """Probability that noise exceeds the threshold of a cell.

    As designed; of an offset what it gives, by the exact law of independent cells or, of cell
    averaging, of cells that windows and padding tie together; NaN of others, which have none.
    The mean over all ranges: at the ends there are more training cells.
    """
    noise = chain.noise(radar)
    if chain.cfar.false_alarm_probability is not None:
        return chain.cfar.false_alarm_probability
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    return _of_offset(chain.cfar, noise, rows.stop - rows.start)


def in_a_frame(radar: Radar, chain: Chain) -> float:
    r"""Probability of a detection in a frame of noise alone.

    .. math:: 1 - e^{-N p q}

    over N cells, p that of a cell and q the share of the cells over threshold that are higher
    than their neighbours, see `theory.clumps`. NaN where clean-up ties cells together otherwise,
    and where one expects more than 0.01 false alarms in a ring of training cells: there they
    come together, so that fewer frames have any.
    """
    noise, p = chain.noise(radar), in_a_cell(radar, chain)
    cfar = chain.cfar
    n_in_ring = len(cfar.ring.offsets(cfar.ring.half_range)) * p
    if not n_in_ring <= _MOST_IN_A_RING or left_by(radar, chain) is not None:
        return np.nan
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    n_cells = (rows.stop - rows.start) * noise.over_velocity.n_bins
    neighbours = Neighbours(
        in_range=_lags(noise.over_range), in_velocity=_lags(noise.over_velocity)
    )
    q = highest_share(p, neighbours, n_summed=noise.n_channels)
    return float(-np.expm1(-n_cells * p * q))


def _lags(transform: Transform) -> tuple[complex, complex]:
    _, one, two = transform.covariance(3)[:, 0].tolist()
    return complex(one), complex(two)


@lru_cache(maxsize=64)
def _of_offset(cfar: Cfar, noise: Noise, n_rows: int) -> float:
    half = cfar.ring.half_range
    some = np.unique(np.linspace(0, half, min(half + 1, _PLACES)).round().astype(int))
    found = [_at_place(cfar, noise, int(place)) for place in some]
    places = cfar.ring.places(n_rows)
    every = np.interp(np.minimum(places, 2 * half - places), some, np.log(found))
    return float(np.mean(np.exp(every)))


def _at_place(cfar: Cfar, noise: Noise, place: int) -> float:
    """Of the cell under test in that row of the box: where the factor is the offset."""
    box, n_channels, offset = cfar.ring.box(noise, place), noise.n_channels, cfar.offset
    assert offset is not None
    closed = cfar.estimator.independent_factor(0.1, box.offsets, n_channels=n_channels)
    if not isinstance(cfar.estimator, CellAveraging) and (not box.is_white or closed is None):
        return np.nan

    def missing(log_pfa: float) -> float:
        factor = cfar.estimator.factor(float(np.exp(log_pfa)), box, n_channels=n_channels)
        return float(np.log(factor.value / offset))

    high, low = np.log(0.5), np.log(0.1)
    if missing(high) > 0:
        return np.nan
    while missing(low) < 0:
        high, low = low, 1.5 * low
        if low < np.log(_RAREST):
            return np.nan
    return float(np.exp(brentq(missing, low, high, xtol=1e-9)))
