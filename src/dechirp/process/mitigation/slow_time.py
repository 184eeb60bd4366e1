"""Filters over slow time: what they share, and what they do to targets at rest."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.findings import Finding
from dechirp.process.mitigation.base import Mitigation, lost_chirps, must_have_chirps, samples_of
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_PER_BIN = 256  # Doppler frequencies at which the width of a notch is looked for
_MOST_LOST = 0.5  # of all velocities: more, and little is left to be seen


class SlowTimeFilter(Mitigation):
    """A linear filter over the chirps of each channel, the same for all ranges.

    Each slot of a round is filtered by itself: its chirps are of the same transmitters.
    """

    advice: ClassVar[str]
    """How to lose less, in a sentence."""

    @property
    @abstractmethod
    def fewest_chirps(self) -> int:
        """Chirps of each transmitter without which nothing is left."""

    @abstractmethod
    def filtered(self, series: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Series (round, n) through the filter; `kept` (round,) tells which are not lost."""

    def over_chirps(self, series: np.ndarray) -> np.ndarray:
        """The filter, of a frame without losses."""
        return self.filtered(series, np.ones(len(series), bool))

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Filter each slot and receiver, sample by sample; see `Mitigation.clean`."""
        self.must_fit(frame)
        given = samples_of(samples, frame)
        kept = ~lost_chirps(given)
        out = np.empty_like(given)
        for slot in range(frame.n_slots):
            own = slice(slot, None, frame.n_slots)
            series = given[own].reshape(frame.n_chirps, -1)
            out[own] = self.filtered(series, kept[own]).reshape(out[own].shape)
        return out

    def must_fit(self, frame: Frame) -> None:
        """Raise `InvalidSetting` if a frame has too few chirps."""
        must_have_chirps(self, frame, self.fewest_chirps)

    def remark(self, radar: Radar) -> list[Finding]:
        """That targets at rest are lost, and which others lose more than 3 dB.

        Of intervals in turn, those of the first: other intervals have other folds.
        """
        frame = radar.at(0).frame
        self.must_fit(frame)
        n = 1 + frame.n_chirps * _PER_BIN // 2
        doppler_hz = np.linspace(0, 0.5 / frame.repetition_s, n)
        passes = self.passed(doppler_hz, frame) >= 0.5
        # A filter may pass nothing to 3 dB: then all are lost.
        lost = float(np.argmax(passes) / (n - 1)) if passes.any() else 1.0
        slow = lost * frame.max_velocity_m_per_s
        again = (
            ""
            if radar.frame.n_intervals > 1
            else f", and as close to multiples of {2 * frame.max_velocity_m_per_s:.4g} m/s"
        )
        return [
            Finding(
                level="warning" if lost > _MOST_LOST else "note",
                setting=f"chain.mitigation.{self.kind()}",
                got="targets whose range does not change are taken out; those of less than"
                f" {slow:.3g} m/s{again}, {lost:.0%} of all velocities, lose more than 3 dB",
                need="targets that move towards the radar or away from it",
                fix=self.advice,
            )
        ]
