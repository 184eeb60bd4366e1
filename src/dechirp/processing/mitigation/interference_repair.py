"""Interference repair of single chirps, by zeros or by autoregression.

References
----------
A. J. E. M. Janssen, R. N. J. Veldhuis and L. B. Vries, "Adaptive interpolation of discrete-time
signals that can be modeled as autoregressive processes", IEEE Trans. ASSP-34(2), 1986.
"""

from abc import abstractmethod

import numpy as np
import scipy

from dechirp.core.checks import check_integer_fields
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.processing.mitigation.base import Mitigation, checked_single_precision_samples
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
        checked = checked_single_precision_samples(samples, frame)
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

    def limitation_findings(self, radar: Radar) -> list[Finding]:
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
                expected=f"{MIN_CHIRPS} chirps and {MIN_SAMPLES} samples, to estimate"
                " the undisturbed signal",
                fix="remove this mitigation; it has no effect",
            )
        ]


@frozen_dataclass
class InterferenceZeroing(InterferenceRepair):
    """Replacement of samples in bursts by the static echoes; moving echoes are zeroed.

    A moving target loses the share of its samples that are zeroed, twice in decibels: 1 dB where
    bursts take 11 % of all samples, or 6 % in the middle of chirps under a Hann window. The lost
    energy spreads over the map: of a target of 20 dB in a sample, more than noise.
    """

    n_taper: int = 4
    """Samples on each side of a burst over which moving echoes fade."""

    def __post_init__(self) -> None:
        check_integer_fields(self, "n_taper", at_least=0, at_most=1000)

    def repair_chirp(
        self, moving: np.ndarray, is_burst: np.ndarray, predictor: np.ndarray
    ) -> np.ndarray:
        """Fade to zero and back, by half a cosine on each side."""
        fade = np.ones(is_burst.size, np.float32)
        for distance in range(self.n_taper, 0, -1):
            level = np.sin(np.pi / 2 * distance / (self.n_taper + 1)) ** 2
            is_near = np.convolve(is_burst, np.ones(2 * distance + 1), "same") > 0
            fade[is_near] = level
        fade[is_burst] = 0
        return moving * fade


@frozen_dataclass
class InterferenceAutoregression(InterferenceRepair):
    """Interpolation of samples in bursts by a linear predictor from both sides.

    The interpolated samples minimise the squared prediction error from the samples before and
    after, with a predictor fitted to the quieter half of the chirps (covariance method, 16
    weights). Targets continue through a burst as far as they stand out of the noise: in a chirp
    of noise and weak targets, the prediction fades to zero as in zeroing.
    """

    def repair_chirp(
        self, moving: np.ndarray, is_burst: np.ndarray, predictor: np.ndarray
    ) -> np.ndarray:
        """Minimise the squared errors of forward and backward prediction."""
        n, order = is_burst.size, predictor.size
        shape = (n - order, n)
        forward = scipy.sparse.diags([*-predictor[::-1], 1], range(order + 1), shape, dtype=complex)
        backward = scipy.sparse.diags(
            [1, *-predictor.conj()], range(order + 1), shape, dtype=complex
        )
        errors = scipy.sparse.vstack([forward, backward]).tocsc()
        burst_free = np.where(is_burst, 0, moving)
        unknown = errors[:, is_burst]
        normal_matrix = (unknown.conj().T @ unknown).todia()
        right_side = -(unknown.conj().T @ (errors @ burst_free.T))
        band = np.zeros((order + 1, right_side.shape[0]), complex)
        for k in range(order + 1):
            diagonal = normal_matrix.diagonal(-k)
            band[k, : diagonal.size] = diagonal
        out = moving.copy()
        solved = scipy.linalg.solveh_banded(band, right_side, lower=True).T
        out[:, is_burst] = solved if np.iscomplexobj(moving) else solved.real
        return out
