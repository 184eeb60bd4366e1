"""Hypotheses about the velocity ambiguity of peaks, and peaks that it is resolved for."""

from typing import NamedTuple

import numpy as np

from dechirp.processing.refine import RefinedPeaks
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

MIN_CONFIDENCE = 0.99
"""Probability from which an ambiguity number counts as known."""


class AmbiguityHypotheses(NamedTuple):
    """Ambiguity numbers that n peaks may have, and their probabilities."""

    probability: np.ndarray
    """(n, n_hypotheses): all are equally likely a priori."""
    number: np.ndarray
    """(n, n_hypotheses), integers: the Doppler frequency is principal + number / repetition."""

    @property
    def certain_ambiguity_numbers_or_nan(self) -> np.ndarray:
        """Likeliest ambiguity number, NaN where its probability is below 0.99, (n,)."""
        best = self.probability.argmax(axis=1)[:, None]
        number = np.take_along_axis(self.number, best, axis=1)[:, 0]
        return np.where(self.confidence >= MIN_CONFIDENCE, number, np.nan)

    @property
    def confidence(self) -> np.ndarray:
        """Probability of the likeliest hypothesis, (n,)."""
        return np.asarray(self.probability.max(axis=1))


class ResolvedPeaks(NamedTuple):
    """Peaks with their Doppler frequencies."""

    peaks: RefinedPeaks
    doppler_hz: np.ndarray
    """(n,): unambiguous where the ambiguity number is certain, else within half a cycle a
    repetition of zero."""
    hypotheses: AmbiguityHypotheses


class FramePeaks(NamedTuple):
    """Peaks of one frame, with the frame that they are from."""

    number: int
    time_s: float
    """Mid-frame."""
    radar: Radar
    """With the interval of the frame."""
    resolved: ResolvedPeaks


def unresolved_hypotheses(n_peaks: int) -> AmbiguityHypotheses:
    """Return the hypotheses of n peaks whose ambiguity number is unknown."""
    return AmbiguityHypotheses(*np.full((2, n_peaks, 1), np.nan))


def resolvable_ambiguity_numbers(frame: Frame, doppler_hz: np.ndarray) -> np.ndarray:
    """Return the ambiguity numbers that a round resolves, (n, n_folds): nearest to zero velocity.

    Slots at even steps of the interval resolve one number per slot: those whose Doppler
    frequencies lie within half a cycle per interval, the span of a single transmitter.
    """
    principal = doppler_hz[:, None] * frame.repetition_s
    candidates = principal + np.arange(frame.n_resolvable_ambiguities)
    nearest = candidates - frame.n_resolvable_ambiguities * np.round(
        candidates / frame.n_resolvable_ambiguities
    )
    return np.asarray(np.round(nearest - principal))
