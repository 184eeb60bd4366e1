"""Mean subtraction: what stands still is the mean over chirps."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.process.mitigation.slow_time import SlowTimeFilter
from dechirp.radar.frame import Frame


@value
class MeanSubtraction(SlowTimeFilter):
    """The mean over the chirps of each channel is subtracted: all that stands still goes.

    The narrowest notch about zero velocity that a frame allows: 0.44 of a velocity cell on each
    side to 3 dB.
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
            out[kept] = series[kept]
            # Sums in double precision: leakage may be 80 dB over the noise.
            wide = np.result_type(series.dtype, np.float64)
            out[kept] -= series[kept].mean(axis=0, dtype=wide).astype(series.dtype)
        return out

    def passed(self, doppler_hz: np.ndarray, frame: Frame) -> np.ndarray:
        """One less the share of a tone's power that is in its mean (Dirichlet's kernel)."""
        self.must_fit(frame)
        turns = np.asarray(doppler_hz, dtype=float) * frame.repetition_s
        # In units of its own period, where it is within half a turn of zero.
        turns = turns - np.rint(turns)
        mean = np.sinc(frame.n_chirps * turns) / np.sinc(turns)
        return np.asarray(1 - mean**2)
