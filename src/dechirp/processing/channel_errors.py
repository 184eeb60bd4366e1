r"""Phase errors of channels, as the residual of a fitted plane wave shows them.

Channels of an array without calibration have phases of their own, which move a direction as noise
does. Noise averages over a frame, they do not. In the amplitudes x_k of the elements,

.. math:: x_k = \alpha a_k(\theta) e^{i (B \epsilon)_k} + w_k,

each transmitter and each receiver has an error epsilon, independent and of one variance, and B adds
both for each element. To first order, the phases of x_k conj(a_k) / alpha move the direction by the
rows of the pseudo-inverse of J = [1, d phase / d theta], and leave (I - J J^+) of them as residual.
The residual therefore estimates the variance of epsilon, and with it the error of the direction. It
cannot show an individual error, since the part that moves the direction is the part that is fitted.

B. D. Steinberg, Principles of Aperture and Array System Design, 1976, 13, for the effect of random
errors of the phases on a beam.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.findings import Finding
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import Directions
from dechirp.radar.radar import Radar

# Chance that noise alone widens the standard error of a detection. The errors of an exact array
# keep their mean square relative to the stated variance within this share.
_SIGNIFICANCE = 0.01
# Largest noise, in rad of phase in an element, of detections that describe the array: 3 degrees, of
# echoes 23 dB over noise and sidelobes.
_MAX_PHASE_NOISE_RAD = float(np.radians(3))
# Least RMS error of the phases that a finding reports: 2 degrees move a direction of an array of
# eight elements by a thousandth of its beamwidth of 13 degrees.
_MIN_REPORTED_RMS_RAD = float(np.radians(2))
# Least degrees of freedom beyond two: Student's distribution has no variance with two or fewer.
# Then the factor, 5 on the variance, keeps 95 % of the errors of two within two standard errors.
_MIN_EXCESS_FREEDOM = 0.5


class ChannelErrors(NamedTuple):
    """Phase errors of the channels by detection; zero or NaN where nothing shows them.

    Detections whose noise hides them have the median of those with noise below three degrees.
    Detections of several sources, and arrays without a residual, have none.
    """

    direction_variance_rad2: np.ndarray
    """Variance of the angles of the strongest source, (n, n_angles), for the resolved angles."""
    phase_rms_rad: np.ndarray
    """RMS error of the phases of each detection with noise below three degrees, (n,); else NaN."""


def estimate_channel_errors(
    snapshots: np.ndarray,
    directions: Directions,
    noise_power: np.ndarray,
    aperture: Aperture,
    n_tx: int,
) -> ChannelErrors:
    """Estimate the phase errors of channels from the residuals of detections with one source.

    Parameters
    ----------
    snapshots : array (n, n_elements), complex
        Amplitudes of the virtual elements, receivers fastest.
    directions : Directions
        Estimated from them.
    noise_power : array (n,)
        Of one element, with the sidelobes of other echoes.
    aperture : Aperture
        The virtual array.
    n_tx : int
        Number of transmitters whose elements are in the array; 1 if all have one transmitter.

    Notes
    -----
    The variance of the channels comes from few residuals, so errors over its root follow Student's
    distribution with nu degrees of freedom, whose variance nu / (nu - 2) is included. nu is the
    effective number by Satterthwaite (Biometrics Bulletin 2(6), 1946).
    """
    n_angles = sum(aperture.resolves_azimuth_and_elevation)
    variance = np.zeros((len(snapshots), n_angles))
    phase_rms = np.full(len(snapshots), np.nan)
    has_angle = np.isfinite(directions.azimuth_rad) | np.isfinite(directions.elevation_rad)
    rows = np.flatnonzero(has_angle[:, 0] & (has_angle.sum(axis=1) == 1))
    n_residuals = aperture.n_elements - 1 - n_angles
    if n_residuals < 1 or not rows.size:
        return ChannelErrors(variance, phase_rms)
    angles = (
        np.nan_to_num(directions.azimuth_rad[rows, 0]),
        np.nan_to_num(directions.elevation_rad[rows, 0]),
    )
    steering = aperture.steering_vectors(*angles)
    relative = snapshots[rows] * steering.conj()
    amplitude = relative.mean(axis=1)
    phase = np.imag(relative / amplitude[:, None])
    slopes = np.imag(aperture.steering_derivatives(*angles) * steering.conj()[:, None])
    design = np.concatenate([np.ones_like(slopes[:, :1]), slopes], axis=1)
    # Rows of J^+, (n, 1 + n_angles, n_elements).
    inverse = np.linalg.pinv(design @ design.swapaxes(1, 2), hermitian=True) @ design
    fitted = np.einsum("nak,nk->na", inverse, phase)
    residual = phase - np.einsum("na,nak->nk", fitted, design)
    power = np.sum(residual**2, axis=1)
    phase_noise = noise_power[rows] / (2 * np.abs(amplitude) ** 2)
    threshold = scipy.special.chdtri(n_residuals, _SIGNIFICANCE)

    # Responses of the angles to the errors of transmitters and receivers, (n, angle, antenna), and
    # the squared responses of the residual, B^T (I - J J^+) B.
    antennas = _antenna_indicators(aperture.n_elements, n_tx)
    antenna_responses = inverse @ antennas
    residual_gram = antennas.T @ antennas - (design @ antennas).swapaxes(1, 2) @ antenna_responses
    total = np.trace(residual_gram, axis1=1, axis2=2)
    effective = total**2 / np.maximum(np.sum(residual_gram**2, axis=(1, 2)), np.finfo(float).tiny)
    student = 1 + 2 / np.maximum(effective - 2, _MIN_EXCESS_FREEDOM)
    excess = np.where(
        power > threshold * phase_noise, np.maximum(power - n_residuals * phase_noise, 0), 0
    )
    # Nothing is left of antennas whose phases all look like directions, but for rounding.
    shows_antennas = total > 1e-9 * np.sum(antennas**2)
    antenna_variance = np.divide(excess, total, out=np.zeros_like(excess), where=shows_antennas)
    shows_array = phase_noise <= _MAX_PHASE_NOISE_RAD**2
    if shows_array.any():
        # Weak echoes have the errors of the array too, which their noise hides.
        antenna_variance = np.maximum(antenna_variance, np.median(antenna_variance[shows_array]))
    variance[rows] = (antenna_variance * student)[:, None] * np.sum(
        antenna_responses[:, 1:] ** 2, axis=2
    )
    phase_rms[rows[shows_array]] = np.sqrt(excess[shows_array] / n_residuals)
    return ChannelErrors(variance, phase_rms)


@lru_cache(maxsize=8)
def _antenna_indicators(n_elements: int, n_tx: int) -> np.ndarray:
    """Return 1 for each transmitter and receiver of an element, (n_elements, n_tx + n_rx).

    Receivers alone where the elements share a transmitter, whose phase is common to all.
    """
    n_rx = n_elements // n_tx
    receivers = np.tile(np.eye(n_rx), (n_tx, 1))
    if n_tx == 1:
        return receivers
    return np.hstack([np.repeat(np.eye(n_tx), n_rx, axis=0), receivers])


def median_or_nan(values: np.ndarray) -> float:
    """Return the median of the values that are not NaN; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else np.nan


def channel_error_findings(phase_rms_rad: Sequence[float], radar: Radar) -> tuple[Finding, ...]:
    """Return a note if the channels of a radar have phases of their own.

    `phase_rms_rad` are the RMS errors of the phases in each frame, NaN where unknown.
    """
    rms_rad = median_or_nan(np.array(phase_rms_rad))
    if not rms_rad >= _MIN_REPORTED_RMS_RAD:
        return ()
    is_calibrated = radar.calibration is not None
    return (
        Finding(
            level="note",
            setting="chain.angle",
            value=f"the phases of the channels differ by {np.degrees(rms_rad):.2g} degrees RMS from"
            " those of a plane wave"
            + (
                ", in spite of the calibration"
                if is_calibrated
                else "; the array is not calibrated"
            )
            + ": the standard errors of directions contain it",
            expected="phases of a plane wave, with one target in a cell, for errors as small as"
            " the noise allows",
            fix='record a reflector at a known angle, measure the array by "dechirp calibrate'
            ' REFLECTOR --azimuth ANGLE --out cal.json", and run with --calibration cal.json',
        ),
    )
