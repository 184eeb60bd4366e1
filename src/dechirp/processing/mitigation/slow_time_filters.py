"""Filters over slow time: base class, and findings on static targets."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.findings import Finding
from dechirp.processing.mitigation.base import (
    Mitigation,
    all_zero_chirp_mask,
    check_chirp_count,
    checked_single_precision_samples,
)
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_FREQUENCIES_PER_BIN = 256  # Doppler frequencies per bin at which the notch width is evaluated
_MAX_LOST_SHARE = 0.5  # of all velocities; a larger share is a warning


class SlowTimeFilter(Mitigation):
    """Linear filter over the chirps of each channel, the same for all ranges.

    Each slot of a round is filtered separately: its chirps have the same transmitters.
    """

    advice: ClassVar[str]
    """Instruction to lose fewer velocities."""

    @property
    @abstractmethod
    def min_chirps(self) -> int:
        """Fewest chirps of each transmitter that leave any signal."""

    @abstractmethod
    def filter_series(self, series: np.ndarray, is_kept: np.ndarray) -> np.ndarray:
        """Filter series (round, n); `is_kept` (round,) marks rounds that are not lost."""

    def filter_chirp_series(self, series: np.ndarray) -> np.ndarray:
        """Filter series of a frame without losses."""
        return self.filter_series(series, np.ones(len(series), bool))

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Filter each slot and receiver, sample by sample; see `Mitigation.clean`."""
        self.check_frame_suits_method(frame)
        checked = checked_single_precision_samples(samples, frame)
        is_kept = ~all_zero_chirp_mask(checked)
        out = np.empty_like(checked)
        for slot in range(frame.n_slots):
            rows = slice(slot, None, frame.n_slots)
            series = checked[rows].reshape(frame.n_chirps, -1)
            out[rows] = self.filter_series(series, is_kept[rows]).reshape(out[rows].shape)
        return out

    def check_frame_suits_method(self, frame: Frame) -> None:
        """Check that a frame has enough chirps."""
        check_chirp_count(self, frame, self.min_chirps)

    def limitation_findings(self, radar: Radar) -> list[Finding]:
        """Report the loss of static targets, and of velocities that lose more than 3 dB.

        For lists of intervals, those of the first: other intervals have other ambiguities.
        """
        frame = radar.for_frame(0).frame
        self.check_frame_suits_method(frame)
        n = 1 + frame.n_chirps * _FREQUENCIES_PER_BIN // 2
        doppler_hz = np.linspace(0, 0.5 / frame.repetition_s, n)
        is_passed = self.doppler_power_gain(doppler_hz, frame) >= 0.5
        # A filter may attenuate all frequencies by more than 3 dB: then all are lost.
        lost_share = float(np.argmax(is_passed) / (n - 1)) if is_passed.any() else 1.0
        notch_m_per_s = lost_share * frame.max_velocity_m_per_s
        aliases = (
            ""
            if radar.frame.n_intervals > 1
            else f", and as close to multiples of {2 * frame.max_velocity_m_per_s:.4g} m/s"
        )
        return [
            Finding(
                level="warning" if lost_share > _MAX_LOST_SHARE else "note",
                setting=f"chain.mitigation.{self.kind()}",
                value="removal of static targets; velocities of less than"
                f" {notch_m_per_s:.3g} m/s{aliases}, {lost_share:.0%} of all velocities, lose"
                " more than 3 dB",
                expected="targets with a radial velocity",
                fix=self.advice,
            )
        ]
