"""Leakage subtraction: removal of static echoes near the radar only.

The band of beat frequencies is separated from the others by the finite sequences with the largest
share of their energy in it (Slepian 1978). Setting bins of a transform to zero would leave -16 dB
of echoes between bins; six sequences more than the band is wide leave -60 dB.
"""

from functools import lru_cache

import numpy as np
import scipy

from dechirp.core.checks import check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.processing.mitigation.base import (
    Mitigation,
    all_zero_chirp_mask,
    check_chirp_count,
    checked_single_precision_samples,
)
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction, tapered_mean
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_EXTRA_SEQUENCES = 6  # each removes 10 dB more of the leakage and half a cell more of range
_EDGE_CELLS = 1.0  # cells by which the band ends before the given range, for that reason
# Cells below zero range in the band: leakage arrives after a cable's length.
_CELLS_BELOW_ZERO = 1.0


@frozen_dataclass
class LeakageSubtraction(Mitigation):
    """Subtraction of the mean over chirps in the nearer ranges only, for leakage and the bumper.

    Static targets farther out stay. The edge is some cells wide: a cell nearer than `max_range_m`
    50 dB are removed, three cells beyond it less than a tenth of a dB.
    """

    max_range_m: float
    """Range up to which static echoes are removed."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "max_range_m", at_most=1e9)

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Subtract the near part of the mean of each channel; see `Mitigation.clean`."""
        self.check_frame_suits_method(frame)
        checked = checked_single_precision_samples(samples, frame)
        is_kept = ~all_zero_chirp_mask(checked)
        basis = self._near_range_beat_basis(frame.chirp)
        out = checked.copy()
        for slot, ramp in enumerate(frame.ramps):
            slot_is_kept = is_kept[slot :: frame.n_slots]
            if not slot_is_kept.any():
                continue
            chirps = np.flatnonzero(slot_is_kept) * frame.n_slots + slot
            # Reversed in time, the negative beats of a falling ramp equal those of a rising one.
            rising_mean = tapered_mean(checked[slot :: frame.n_slots], slot_is_kept)[
                :, :: ramp.sign
            ]
            leakage = (rising_mean @ basis.conj().T) @ basis
            out[chirps] -= leakage[:, :: ramp.sign].astype(checked.dtype)
        return out

    def filter_chirp_series(self, series: np.ndarray) -> np.ndarray:
        """Filter as mean subtraction, which applies in the nearer ranges."""
        return MeanSubtraction().filter_chirp_series(series)

    def filtered_fraction_of_range_bins(
        self, range_window_weights: np.ndarray, chirp: Chirp, n_bins: int
    ) -> np.ndarray:
        """Return the share of each range bin in the nearer ranges."""
        basis = self._near_range_beat_basis(chirp)
        spectra = np.fft.fft(range_window_weights * basis, n_bins, axis=1)
        return np.asarray(np.sum(np.abs(spectra) ** 2, axis=0) / np.sum(range_window_weights**2))

    def limitation_findings(self, radar: Radar) -> list[Finding]:
        """Note the loss of static targets in the nearer ranges."""
        self.check_frame_suits_method(radar.frame)
        cell_m = radar.frame.chirp.range_resolution_m
        return [
            Finding(
                level="note",
                setting=f"chain.mitigation.{self.kind()}",
                value=f"removal of static targets nearer than {self.max_range_m:.4g} m together"
                " with"
                f" the leakage; up to {3 * cell_m:.2g} m beyond, partly",
                expected="targets that move, or that are farther away",
                fix="lower max_range to the extent of the leakage plus a range cell or two",
            )
        ]

    def check_frame_suits_method(self, frame: Frame) -> None:
        """Check that a frame has several chirps and that the range limit lies within its ranges."""
        check_chirp_count(self, frame, MeanSubtraction().min_chirps)
        chirp = frame.chirp
        most_m = chirp.max_range_m - (_EXTRA_SEQUENCES + 1) * chirp.range_resolution_m
        if self.max_range_m > most_m:
            raise InvalidSetting(
                "LeakageSubtraction.max_range_m",
                value=f"{self.max_range_m:.6g} m",
                expected=f"at most {most_m:.6g} m, {_EXTRA_SEQUENCES + 1} cells less than the"
                " largest range",
                fix="use mean-subtraction to clear all ranges, or give the extent of the leakage",
            )

    def _near_range_beat_basis(self, chirp: Chirp) -> np.ndarray:
        """Return orthonormal sequences that span the band, (n, n_samples)."""
        cells = self.max_range_m / chirp.range_resolution_m - _EDGE_CELLS
        return _slepian_sequences(chirp.n_samples, cells, chirp.sampling == "complex")


@lru_cache(maxsize=8)
def _slepian_sequences(n_samples: int, n_range_cells: float, is_complex: bool) -> np.ndarray:
    low = -_CELLS_BELOW_ZERO if is_complex else -max(n_range_cells, _CELLS_BELOW_ZERO)
    high = max(n_range_cells, _CELLS_BELOW_ZERO)
    half = (high - low) / 2  # time times half the bandwidth
    n = min(round(2 * half) + _EXTRA_SEQUENCES, n_samples)
    slepian = scipy.signal.windows.dpss(n_samples, half, n)
    if not is_complex:
        return np.asarray(slepian)
    cycles = (high + low) / 2 / n_samples * np.arange(n_samples)
    return np.asarray(slepian * np.exp(2j * np.pi * cycles))
