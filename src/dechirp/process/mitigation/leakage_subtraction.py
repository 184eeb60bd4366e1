"""Leakage subtraction: what stands still near the radar, and nothing farther out.

The band of beat frequencies is parted from the others by the sequences of finite length that
have the most of their energy in it (Slepian 1978). Setting bins of a transform to zero would
leave -16 dB of what lies between bins; six sequences more than the band is wide leave -60 dB.
"""

from functools import lru_cache

import numpy as np
from scipy.signal.windows import dpss

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.process.mitigation.base import Mitigation, lost_chirps, must_have_chirps, samples_of
from dechirp.process.mitigation.mean_subtraction import MeanSubtraction, still
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_MORE = 6  # sequences: each takes 10 dB more of the leakage, and half a cell more of range
_WITHIN = 1.0  # cells by which the band ends before the range that is given, for that reason
_BELOW = 1.0  # cells below zero range that count as near: leakage comes down a cable's length


@value
class LeakageSubtraction(Mitigation):
    """The mean over chirps is subtracted in the nearer ranges only: leakage, and the bumper.

    Targets that stop farther out stay. The edge is some cells wide: nearer than `max_range_m` by
    a cell 50 dB are taken, beyond it by three cells less than a tenth of a dB.
    """

    max_range_m: float
    """To which what stands still is taken out."""

    def __post_init__(self) -> None:
        positive(self, "max_range_m", at_most=1e9)

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Subtract the near part of the mean of each channel; see `Mitigation.clean`."""
        self.must_fit(frame)
        given = samples_of(samples, frame)
        kept = ~lost_chirps(given)
        basis = self._basis(frame.chirp)
        out = given.copy()
        for slot, ramp in enumerate(frame.ramps):
            rounds = kept[slot :: frame.n_slots]
            if not rounds.any():
                continue
            own = np.flatnonzero(rounds) * frame.n_slots + slot
            # Beats of a falling ramp are negative: backwards, they are as those of a rising one.
            forwards = still(given[slot :: frame.n_slots], rounds)[:, :: ramp.sign]
            near = (forwards @ basis.conj().T) @ basis
            out[own] -= near[:, :: ramp.sign].astype(given.dtype)
        return out

    def over_chirps(self, series: np.ndarray) -> np.ndarray:
        """In the nearer ranges, as mean subtraction."""
        return MeanSubtraction().over_chirps(series)

    def share_of_ranges(self, weights: np.ndarray, chirp: Chirp, n_bins: int) -> np.ndarray:
        """How much of each range bin lies in the nearer ranges."""
        basis = self._basis(chirp)
        within = np.fft.fft(weights * basis, n_bins, axis=1)
        return np.asarray(np.sum(np.abs(within) ** 2, axis=0) / np.sum(weights**2))

    def remark(self, radar: Radar) -> list[Finding]:
        """That targets at rest are lost in the nearer ranges."""
        self.must_fit(radar.frame)
        cell_m = radar.frame.chirp.range_resolution_m
        return [
            Finding(
                level="note",
                setting=f"chain.mitigation.{self.kind()}",
                got=f"nearer than {self.max_range_m:.4g} m targets whose range does not change are"
                f" taken out with the leakage; up to {3 * cell_m:.2g} m beyond, partly",
                need="targets that move, or farther ones",
                fix="Lower max_range to the length of the leakage, with a range cell or two.",
            )
        ]

    def must_fit(self, frame: Frame) -> None:
        """Raise `InvalidSetting` if a frame has one chirp, or ends before the range does."""
        must_have_chirps(self, frame, MeanSubtraction().fewest_chirps)
        chirp = frame.chirp
        most_m = chirp.max_range_m - (_MORE + 1) * chirp.range_resolution_m
        if self.max_range_m > most_m:
            raise InvalidSetting(
                "LeakageSubtraction.max_range_m",
                got=f"{self.max_range_m:.6g} m",
                need=f"at most {most_m:.6g} m, {_MORE + 1} cells less than the largest range",
                fix="Take mean-subtraction to clear all ranges, or give the length of the leakage.",
            )

    def _basis(self, chirp: Chirp) -> np.ndarray:
        """Orthonormal sequences that hold the band, (n, n_samples)."""
        cells = self.max_range_m / chirp.range_resolution_m - _WITHIN
        return _sequences(chirp.n_samples, cells, chirp.sampling == "complex")


@lru_cache(maxsize=8)
def _sequences(n_samples: int, cells: float, is_complex: bool) -> np.ndarray:
    low = -_BELOW if is_complex else -max(cells, _BELOW)
    high = max(cells, _BELOW)
    half = (high - low) / 2  # time times half the bandwidth
    n = min(round(2 * half) + _MORE, n_samples)
    slepian = dpss(n_samples, half, n)
    if not is_complex:
        return np.asarray(slepian)
    turns = (high + low) / 2 / n_samples * np.arange(n_samples)
    return np.asarray(slepian * np.exp(2j * np.pi * turns))
