"""Mean subtraction: removal of static echoes, the mean over chirps."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.mitigation.slow_time_filters import SlowTimeFilter
from dechirp.radar.frame import Frame


@frozen_dataclass
class MeanSubtraction(SlowTimeFilter):
    """Subtraction of the mean over the chirps of each channel, which removes all static echoes.

    The mean has a Hann taper. A target that moves by k cells contributes to the plain mean too,
    with 1 / (pi k) of its amplitude, and its subtraction would leave a residual at zero velocity
    in its range: false targets for echoes of 50 dB and more. Under the taper it is 31 dB less
    from two cells on, and falls by 18 dB an octave, as its sidelobes in the map do. Targets of
    less than 0.43 of a velocity cell lose more than 3 dB; those of one cell gain 1 dB.
    """

    advice: ClassVar[str] = (
        "use leakage-subtraction or no mitigation to keep stopped targets; a longer frame loses"
        " fewer velocities"
    )

    @property
    def min_chirps(self) -> int:
        """2, since the mean of a single chirp is the chirp."""
        return 2

    def filter_series(self, series: np.ndarray, is_kept: np.ndarray) -> np.ndarray:
        """Subtract the mean over kept rounds; zeros elsewhere."""
        out = np.zeros_like(series)
        if is_kept.any():
            out[is_kept] = series[is_kept] - tapered_mean(series, is_kept).astype(series.dtype)
        return out

    def doppler_power_gain(self, doppler_hz: np.ndarray, frame: Frame) -> np.ndarray:
        """Return the mean square of a tone less its tapered mean, over that of the tone.

        1 - 2 C D + C^2 with its plain mean D (Dirichlet's kernel) and its tapered one C.
        """
        self.check_frame_suits_method(frame)
        n = frame.n_chirps
        cycles = np.asarray(doppler_hz, dtype=float) * frame.repetition_s
        cycles = cycles - np.rint(cycles)
        plain = _dirichlet_kernel(cycles, n)
        neighbours = _dirichlet_kernel(cycles - 1 / n, n) + _dirichlet_kernel(cycles + 1 / n, n)
        tapered = plain + neighbours / 2
        return np.asarray(1 - 2 * tapered * plain + tapered**2)


def tapered_mean(series: np.ndarray, is_kept: np.ndarray) -> np.ndarray:
    """Return the mean of series (round, ...) over kept rounds under a Hann taper, in float64.

    Leakage may be 80 dB over the noise. The taper has no zeros, so that two chirps have a mean.
    """
    n = len(series)
    weights = np.sin(np.pi * (np.arange(n) + 0.5) / n)[is_kept] ** 2
    dtype = np.result_type(series.dtype, np.float64)
    return np.tensordot(weights / weights.sum(), series[is_kept].astype(dtype), 1)


def _dirichlet_kernel(cycles: np.ndarray, n: int) -> np.ndarray:
    """Return Dirichlet's kernel: the mean of n points of a tone, relative to their middle."""
    denominator = np.sin(np.pi * cycles)
    is_integer = abs(denominator) < 1e-9
    limit = np.cos(np.pi * n * cycles) / np.cos(np.pi * cycles)
    return np.where(
        is_integer, limit, np.sin(np.pi * n * cycles) / np.where(is_integer, 1, n * denominator)
    )
