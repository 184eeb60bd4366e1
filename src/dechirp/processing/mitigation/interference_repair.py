"""Interference repair of single chirps: base class."""

from abc import abstractmethod

import numpy as np

from dechirp.core.findings import Finding
from dechirp.processing.mitigation.base import Mitigation, check_frame_samples
from dechirp.processing.mitigation.burst_detection import detect_bursts
from dechirp.processing.quality.background import MIN_CHIRPS, MIN_SAMPLES
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


class InterferenceRepair(Mitigation):
    """Detection of bursts chirp by chirp, with reconstruction of the moving echoes in them.

    Static echoes are known from the other chirps and are kept. Frames without bursts stay
    bit-identical: white noise contains a burst with a probability below 1e-12 a chirp.
    """

    @abstractmethod
    def repair_chirp(
        self, moving: np.ndarray, is_burst: np.ndarray, predictor: np.ndarray
    ) -> np.ndarray:
        """Return the moving echoes of one chirp, (rx, sample), reconstructed in bursts.

        `is_burst` (sample,) marks the samples; `predictor` (order,) holds the weights of the
        samples before, the nearest first, that predict the next.
        """

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Repair the chirps that have bursts; see `Mitigation.clean`."""
        checked = check_frame_samples(samples, frame)
        bursts = detect_bursts(checked, frame)
        if bursts is None:
            return checked
        out = checked.copy()
        for chirp in np.flatnonzero(bursts.is_burst.any(axis=1)):
            moving = checked[chirp] - bursts.static_samples[chirp % frame.n_slots]
            # Adding the difference keeps all other samples bit-identical.
            out[chirp] += (
                self.repair_chirp(moving, bursts.is_burst[chirp], bursts.predictor) - moving
            )
        return out

    def target_findings(self, radar: Radar) -> list[Finding]:
        """Warn about frames with too few chirps or samples for burst detection."""
        frame = radar.frame
        if frame.n_chirps >= MIN_CHIRPS and frame.chirp.n_samples >= MIN_SAMPLES:
            return []
        return [
            Finding(
                level="warning",
                setting=f"chain.mitigation.{self.kind()}",
                value=f"frames of {frame.n_chirps} chirps of each transmitter and"
                f" {frame.chirp.n_samples} samples, too few for burst detection",
                expected=f"{MIN_CHIRPS} chirps and {MIN_SAMPLES} samples, to know the"
                " undisturbed signal",
                fix="remove this mitigation; it has no effect",
            )
        ]
