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

    Needs no other chirp, and copes with bursts in half of a chirp, where at most 32 echoes stand
    out of the noise. Each echo continues through the burst with the error of its estimate. Frames
    without bursts stay bit-identical: a chirp of noise has one with a probability of 1e-12. Takes
    some 30 ms for a chirp of 1,000 samples, so that frames of four chirps or more are repaired
    faster by `InterferenceAutoregression`. See `tone_fit`.
    """

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Repair the chirps that have bursts; see `Mitigation.clean`."""
        checked = checked_single_precision_samples(samples, frame)
        if checked.shape[2] < MIN_SAMPLES:
            return checked
        out = checked
        for chirp in np.flatnonzero(~all_zero_chirp_mask(checked)).tolist():
            fit = fit_tones_outside_bursts(checked[chirp])
            if fit.is_burst.any():
                out = checked.copy() if out is checked else out
                out[chirp][:, fit.is_burst] = fit.tones[:, fit.is_burst]
        return out

    def limitation_findings(self, radar: Radar) -> list[Finding]:
        """Warn about chirps of too few samples, and recommend the faster method."""
        frame = radar.frame
        if frame.chirp.n_samples < MIN_SAMPLES:
            return [
                Finding(
                    level="warning",
                    setting=f"chain.mitigation.{self.kind()}",
                    value=f"chirps of {frame.chirp.n_samples} samples, too few to detect bursts",
                    expected=f"{MIN_SAMPLES} samples or more",
                    fix="remove this mitigation; it has no effect",
                )
            ]
        if frame.n_chirps >= MIN_CHIRPS:
            return [
                Finding(
                    level="note",
                    setting=f"chain.mitigation.{self.kind()}",
                    value=f"fits every one of {frame.n_chirps_total} chirps alone",
                    expected=f"frames of fewer than {MIN_CHIRPS} chirps, or time to wait",
                    fix="use interference-autoregression, which learns from all chirps",
                )
            ]
        return []
