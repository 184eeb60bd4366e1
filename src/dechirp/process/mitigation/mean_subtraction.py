"""Mean subtraction: what stands still is the mean over chirps."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.process.mitigation.slow_time import SlowTimeFilter
from dechirp.radar.frame import Frame


@value
class MeanSubtraction(SlowTimeFilter):
    """The mean over the chirps of each channel is subtracted: all that stands still goes.

    A mean under a Hann taper. A target that moves by k cells is in the plain mean too, at
    1 / (pi k) of its amplitude, and what is subtracted of it would stand at zero velocity in its
    range: false targets beside echoes of 50 dB and more. Under the taper it is 31 dB less from
    two cells on, and falls by 18 dB an octave, as its sidelobes in the map do. Targets of less
    than 0.43 of a velocity cell lose more than 3 dB; those of one gain 1 dB.
    """

    advice: ClassVar[str] = (
        "Where targets that stop count, take leakage-subtraction or none; of a longer frame fewer"
        " velocities are lost."
    )

    @property
    def fewest_chirps(self) -> int:
        """2: of one, the mean is all there is."""
        return 2

    def filtered(self, series: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Series less their mean over what is kept; zeros where it is not."""
        out = np.zeros_like(series)
        if kept.any():
            out[kept] = series[kept] - still(series, kept).astype(series.dtype)
        return out

    def passed(self, doppler_hz: np.ndarray, frame: Frame) -> np.ndarray:
        """Mean square of a tone less its tapered mean, over that of the tone.

        1 - 2 C D + C^2 with its plain mean D (Dirichlet's kernel) and its tapered one C.
        """
        self.must_fit(frame)
        n = frame.n_chirps
        turns = np.asarray(doppler_hz, dtype=float) * frame.repetition_s
        turns = turns - np.rint(turns)
        plain = _mean_of_tone(turns, n)
        beside = _mean_of_tone(turns - 1 / n, n) + _mean_of_tone(turns + 1 / n, n)
        tapered = plain + beside / 2
        return np.asarray(1 - 2 * tapered * plain + tapered**2)


def still(series: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Mean of series (round, ...) over what is kept, under a Hann taper; double precision.

    Leakage may be 80 dB over the noise. The taper has no zeros, so that two chirps have a mean.
    """
    n = len(series)
    weights = np.sin(np.pi * (np.arange(n) + 0.5) / n)[kept] ** 2
    wide = np.result_type(series.dtype, np.float64)
    return np.tensordot(weights / weights.sum(), series[kept].astype(wide), 1)


def _mean_of_tone(turns: np.ndarray, n: int) -> np.ndarray:
    """Dirichlet's kernel: mean of n points of a tone, seen from their middle."""
    below = np.sin(np.pi * turns)
    at_whole = abs(below) < 1e-9
    limit = np.cos(np.pi * n * turns) / np.cos(np.pi * turns)
    return np.where(at_whole, limit, np.sin(np.pi * n * turns) / np.where(at_whole, 1, n * below))
