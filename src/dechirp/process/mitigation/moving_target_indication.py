"""Moving-target indication: each chirp less those before it, a delay-line canceller.

M. I. Skolnik, Introduction to Radar Systems, 3rd ed., 3.2: single, double and triple cancellers
with binomial weights.
"""

from math import comb
from typing import ClassVar

import numpy as np

from dechirp.core.checks import count
from dechirp.core.values import value
from dechirp.process.mitigation.slow_time import SlowTimeFilter
from dechirp.radar.frame import Frame


@value
class MovingTargetIndication(SlowTimeFilter):
    """Differences of successive chirps, taken once to three times.

    A wide notch, for clutter that moves a little. The weights are scaled so that white noise
    keeps its power; a target in the middle between two lost velocities then gains up to 3, 4.3
    or 5.1 dB. The first chirps of a frame, as many as the order, have none before them: they
    become zeros.
    """

    order: int = 1
    """How often differences are taken, 1 to 3: a sixth, 23 % or 26 % of the velocities between
    two lost ones, on each side of both, lose more than 3 dB."""

    advice: ClassVar[str] = (
        "Take mean-subtraction, whose notch is as narrow as a frame allows, or a lower order."
    )

    def __post_init__(self) -> None:
        count(self, "order", at_most=3)

    @property
    def fewest_chirps(self) -> int:
        """One more than the order."""
        return self.order + 1

    def filtered(self, series: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Weighted sums of a value and those before it; zeros where one of them is lost."""
        out = np.zeros_like(series)
        whole = np.zeros(len(series), bool)
        whole[self.order :] = True
        for delay, weight in enumerate(self._weights):
            before = slice(0, len(series) - delay)
            out[delay:] += series.dtype.type(weight) * series[before]
            whole[delay:] &= kept[before]
        out[~whole] = 0
        return out

    def passed(self, doppler_hz: np.ndarray, frame: Frame) -> np.ndarray:
        """Gain of the filter, (2 sin pi f T)^2n over the sum of the squared weights."""
        self.must_fit(frame)
        turns = np.asarray(doppler_hz, dtype=float) * frame.repetition_s
        # That sum is a binomial coefficient too (Vandermonde).
        return np.asarray(
            (2 * np.sin(np.pi * turns)) ** (2 * self.order) / comb(2 * self.order, self.order)
        )

    @property
    def _weights(self) -> np.ndarray:
        signed = [(-1) ** k * comb(self.order, k) for k in range(self.order + 1)]
        return np.array(signed) / np.sqrt(comb(2 * self.order, self.order))
