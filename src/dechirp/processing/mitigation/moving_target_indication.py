"""Moving-target indication: a delay-line canceller over the chirps.

M. I. Skolnik, Introduction to Radar Systems, 3rd ed., 3.2: single, double and triple cancellers
with binomial weights.
"""

from math import comb
from typing import ClassVar

import numpy as np

from dechirp.core.checks import check_integer_fields
from dechirp.core.values import frozen_dataclass
from dechirp.processing.mitigation.slow_time_filters import SlowTimeFilter
from dechirp.radar.frame import Frame


@frozen_dataclass
class MovingTargetIndication(SlowTimeFilter):
    """Differences of successive chirps, taken once to three times.

    A wide notch, for clutter that moves a little. The weights are scaled so that white noise
    keeps its power; a target in the middle between two blind velocities then gains up to 3, 4.3
    or 5.1 dB. The first chirps of a frame, as many as the order, have no predecessors and become
    zeros.
    """

    order: int = 1
    """Number of successive differences, 1 to 3: a sixth, 23 % or 26 % of the velocities between
    two blind ones, on each side of both, lose more than 3 dB."""

    advice: ClassVar[str] = (
        "use mean-subtraction, whose notch is as narrow as a frame allows, or a lower order"
    )

    def __post_init__(self) -> None:
        check_integer_fields(self, "order", at_most=3)

    @property
    def min_chirps(self) -> int:
        """One more than the order."""
        return self.order + 1

    def filter_series(self, series: np.ndarray, is_kept: np.ndarray) -> np.ndarray:
        """Return weighted sums of a value and those before it; zeros where one of them is lost."""
        out = np.zeros_like(series)
        is_complete = np.zeros(len(series), bool)
        is_complete[self.order :] = True
        for delay, weight in enumerate(self._canceller_weights):
            earlier = slice(0, len(series) - delay)
            out[delay:] += series.dtype.type(weight) * series[earlier]
            is_complete[delay:] &= is_kept[earlier]
        out[~is_complete] = 0
        return out

    def doppler_power_gain(self, doppler_hz: np.ndarray, frame: Frame) -> np.ndarray:
        """Return the gain of the filter, (2 sin pi f T)^2n over the sum of the squared weights."""
        self.check_frame_suits_method(frame)
        cycles = np.asarray(doppler_hz, dtype=float) * frame.repetition_s
        # That sum is a binomial coefficient too (Vandermonde).
        return np.asarray(
            (2 * np.sin(np.pi * cycles)) ** (2 * self.order) / comb(2 * self.order, self.order)
        )

    @property
    def _canceller_weights(self) -> np.ndarray:
        signed = [(-1) ** k * comb(self.order, k) for k in range(self.order + 1)]
        return np.array(signed) / np.sqrt(comb(2 * self.order, self.order))
