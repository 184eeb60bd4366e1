"""Clean-up of samples, before any transform: what all methods share."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.radar.chirp import Chirp
from dechirp.radar.cube import must_be_sampled_as
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


class Mitigation(Family):
    """What is taken out of the samples of a frame before they are transformed.

    A member must give `clean`. One that is linear over the chirps says so by `over_chirps`,
    from which `noise_left` knows what it makes of noise; and `share_of_ranges`, if it acts on
    some ranges only.
    """

    group: ClassVar[str] = "dechirp.mitigation"

    @abstractmethod
    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """The samples of one frame without what the method takes out.

        Parameters
        ----------
        samples : array (chirp, rx, sample), complex, or real under real sampling
            In the order sent. Chirps of nothing but zeros are lost, and stay so.
        frame : Frame
            With the one interval of this frame.

        Returns
        -------
        array (chirp, rx, sample), complex64 or float32
            What was given, untouched, or other samples; what was given is never changed.

        Raises
        ------
        InvalidSetting
            If the samples are not such a frame's, or not finite, or the chirps too few.
        """

    def must_fit(self, frame: Frame) -> None:
        """Raise `InvalidSetting` if a frame is too short for the method to leave anything."""

    def passed(self, doppler_hz: np.ndarray, frame: Frame) -> np.ndarray:
        """Power that a target of that Doppler frequency keeps, a ratio; of any shape.

        Over the whole frame, of a target in all ranges; 1 for what does not filter slow time.
        """
        return np.ones(np.shape(doppler_hz))

    def over_chirps(self, series: np.ndarray) -> np.ndarray:
        """What becomes of series of one value a round, (round, n): linear; the same here."""
        return series

    @property
    def filters_slow_time(self) -> bool:
        """Whether it acts on all chirps alike, so that noise is not the same at all velocities."""
        return type(self).over_chirps is not Mitigation.over_chirps

    def share_of_ranges(self, weights: np.ndarray, chirp: Chirp, n_bins: int) -> np.ndarray:
        """Share of the noise in each range bin on which `over_chirps` acts, (n_bins,).

        `weights` (n_samples,) is the window of the range transform. Bins of the whole transform,
        also of real samples.
        """
        return np.ones(n_bins)

    def remark(self, radar: Radar) -> list[Finding]:
        """What it does to targets that the user may want: those at rest, or in some ranges."""
        return []


def samples_of(samples: np.ndarray, frame: Frame) -> np.ndarray:
    """Samples of one frame in single precision, contiguous, or `InvalidSetting`.

    The array itself where it is so.
    """
    chirp, shape = frame.chirp, np.shape(samples)
    wanted = (frame.n_sent, chirp.n_samples)
    if len(shape) != 3 or (shape[0], shape[2]) != wanted:
        raise InvalidSetting(
            "samples",
            got=f"an array of shape {shape}",
            need=f"(chirp, rx, sample) with {wanted[0]} chirps and {wanted[1]} samples",
            fix="Give all chirps of one frame in the order sent, and the frame they are of.",
        )
    must_be_sampled_as(chirp, np.asarray(samples), where="samples")
    kept = np.ascontiguousarray(samples, np.complex64 if np.iscomplexobj(samples) else np.float32)
    if not np.isfinite(kept).all():
        raise InvalidSetting(
            "samples",
            got="some that are not finite (NaN or infinite)",
            need="finite samples throughout",
            fix="Find what wrote them, or replace them by zeros.",
        )
    return kept


def must_have_chirps(method: Mitigation, frame: Frame, fewest: int) -> None:
    """Raise `InvalidSetting` if a frame has fewer chirps of each transmitter."""
    if frame.n_chirps < fewest:
        raise InvalidSetting(
            "Frame.n_chirps",
            got=f"{frame.n_chirps}, under mitigation of kind {method.kind()}",
            need=f"at least {fewest}: of fewer nothing is left",
            fix="Leave that mitigation out, or send more chirps.",
        )


def lost_chirps(samples: np.ndarray) -> np.ndarray:
    """Chirps of nothing but zeros, (chirp,) bool: readers put them where some are lost."""
    return np.asarray(~samples.any(axis=(1, 2)))
