"""Interference repair of frames of few chirps, by the tones of each chirp."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.processing.mitigation.base import (
    Mitigation,
    all_zero_chirp_mask,
    checked_single_precision_samples,
)
from dechirp.processing.mitigation.tone_fit import fit_tones_outside_bursts
from dechirp.processing.quality.background import MIN_CHIRPS, MIN_SAMPLES
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


@frozen_dataclass
class InterferenceTones(Mitigation):
    """Replacement of samples in bursts by tones that are fitted to the rest of the same chirp.

    For frames of fewer than four chirps, which do not show their static echoes: longer frames are
    left to the other methods. Copes with bursts in half of a chirp, where echoes are few tones in
    white noise; other chirps stay as they are. Each echo continues through the burst with the error
    of its estimate. Frames without bursts stay bit-identical: a chirp of noise has one with a
    probability of 1e-12. Transients that each chirp has at its start are bursts as well. See
    `tone_fit`.
    """

    keep_noise: bool = True
    """Keep the samples outside bursts. False: chirps with bursts become the tones alone, without
    noise, to show or measure strong echoes; weak ones vanish and thresholds of noise do not hold.
    """

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Repair the chirps that have bursts; see `Mitigation.clean`."""
        checked = checked_single_precision_samples(samples, frame)
        if frame.n_chirps >= MIN_CHIRPS or checked.shape[2] < MIN_SAMPLES:
            return checked
        out = checked
        for chirp in np.flatnonzero(~all_zero_chirp_mask(checked)).tolist():
            fit = fit_tones_outside_bursts(checked[chirp])
            if fit.is_burst.any():
                out = checked.copy() if out is checked else out
                is_replaced = fit.is_burst if self.keep_noise else np.ones_like(fit.is_burst)
                out[chirp][:, is_replaced] = fit.tones[:, is_replaced]
        return out

    def limitation_findings(self, radar: Radar) -> list[Finding]:
        """Warn about frames that this method leaves as they are."""
        frame = radar.frame
        if frame.n_chirps < MIN_CHIRPS and frame.chirp.n_samples >= MIN_SAMPLES:
            if self.keep_noise:
                return []
            return [
                Finding(
                    level="warning",
                    setting=f"chain.mitigation.{self.kind()}.keep_noise",
                    value="false: chirps with bursts lose their noise",
                    expected="noise in all chirps, from which thresholds are estimated",
                    fix="use keep_noise: true for detection",
                )
            ]
        return [
            Finding(
                level="warning",
                setting=f"chain.mitigation.{self.kind()}",
                value=f"frames of {frame.n_chirps} chirps of each transmitter and"
                f" {frame.chirp.n_samples} samples, which it leaves as they are",
                expected=f"fewer than {MIN_CHIRPS} chirps, and {MIN_SAMPLES} samples or more",
                fix="use interference-autoregression, which learns from all chirps",
            )
        ]
