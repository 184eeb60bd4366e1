"""Mitigation of samples before any transform: base class and checks."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.processing.scaling import to_single_precision
from dechirp.radar.chirp import Chirp
from dechirp.radar.cube import check_samples_complex_or_real
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


class Mitigation(Family):
    """Method that removes unwanted signals from the samples of a frame before any transform.

    A member must implement `clean`. A member that is linear over the chirps implements
    `filter_chirp_series`, from which `mitigation_noise_gain` derives its effect on noise, and
    `filtered_fraction_of_range_bins` if it acts on some ranges only.
    """

    group: ClassVar[str] = "dechirp.mitigation"

    @abstractmethod
    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Remove the unwanted signal from the samples of one frame.

        Parameters
        ----------
        samples : array (chirp, rx, sample), complex, or real under real sampling
            Samples in transmit order. All-zero chirps are lost, and stay zero.
        frame : Frame
            Frame with the single interval of this frame.

        Returns
        -------
        array (chirp, rx, sample), complex64 or float32
            The given array or a new one; the given samples are never modified.

        Raises
        ------
        InvalidSetting
            If the samples do not match the frame, are not finite, or have too few chirps.
        """

    def check_frame_suits_method(self, frame: Frame) -> None:
        """Check that a frame is long enough for the method to leave any signal."""

    def doppler_power_gain(self, doppler_hz: np.ndarray, frame: Frame) -> np.ndarray:
        """Return the power gain for a target of a Doppler frequency, a ratio; of any shape.

        Over the whole frame, of a target in all ranges; 1 for methods that do not filter slow
        time.
        """
        return np.ones(np.shape(doppler_hz))

    def filter_chirp_series(self, series: np.ndarray) -> np.ndarray:
        """Filter series of one value a round, (round, n), linearly; unchanged by default."""
        return series

    @property
    def filters_slow_time(self) -> bool:
        """True if the method filters all chirps, so that noise depends on velocity."""
        return type(self).filter_chirp_series is not Mitigation.filter_chirp_series

    def filtered_fraction_of_range_bins(
        self, range_window_weights: np.ndarray, chirp: Chirp, n_bins: int
    ) -> np.ndarray:
        """Return the share of the noise in each range bin on which the filter acts, (n_bins,).

        `range_window_weights` (n_samples,) is the window of the range transform. Bins of the whole
        transform, also of real samples.
        """
        return np.ones(n_bins)

    def limitation_findings(self, radar: Radar) -> list[Finding]:
        """Return findings on the limitations of the method, such as weakened static targets."""
        return []


def checked_single_precision_samples(samples: np.ndarray, frame: Frame) -> np.ndarray:
    """Return the samples of one frame, contiguous in single precision, or raise an error.

    Returns the given array if it already is.
    """
    chirp, shape = frame.chirp, np.shape(samples)
    expected = (frame.n_chirps_total, chirp.n_samples)
    if len(shape) != 3 or (shape[0], shape[2]) != expected:
        raise InvalidSetting(
            "samples",
            value=f"an array of shape {shape}",
            expected=f"(chirp, rx, sample) with {expected[0]} chirps and {expected[1]} samples",
            fix="give all chirps of one frame in transmit order, and the matching frame",
        )
    check_samples_complex_or_real(chirp, np.asarray(samples), setting="samples")
    contiguous = to_single_precision(
        samples, is_complex=np.iscomplexobj(samples), setting="samples"
    )
    if not np.isfinite(contiguous).all():
        raise InvalidSetting(
            "samples",
            value="some that are not finite (NaN or infinite)",
            expected="finite samples throughout",
            fix="find the source of these values, or replace them by zeros",
        )
    return contiguous


def check_chirp_count(method: Mitigation, frame: Frame, min_chirps: int) -> None:
    """Check that a frame has enough chirps of each transmitter."""
    if frame.n_chirps < min_chirps:
        raise InvalidSetting(
            "Frame.n_chirps",
            value=f"{frame.n_chirps}, under mitigation of kind {method.kind()}",
            expected=f"at least {min_chirps}, since fewer leave no signal",
            fix="remove this mitigation, or send more chirps",
        )


def all_zero_chirp_mask(samples: np.ndarray) -> np.ndarray:
    """Return a mask of all-zero chirps, (chirp,) bool: readers insert them for lost ones."""
    return np.asarray(~samples.any(axis=(1, 2)))
