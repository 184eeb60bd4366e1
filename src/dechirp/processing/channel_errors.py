r"""Phase errors of channels, as the residual of fitted plane waves shows them.

Channels of an array without calibration have phases of their own, which move a direction as noise
does. Noise averages over a frame, they do not. In the amplitudes x_k of the elements,

.. math:: x_k = \alpha a_k(\theta) e^{i (B \epsilon)_k} + w_k,

each transmitter and each receiver has an error epsilon, independent and of one variance, and B adds
both for each element. To first order, the phases of x_k conj(a_k) / alpha move the direction by the
rows of the pseudo-inverse of J = [1, d phase / d theta], and leave (I - J J^+) of them as residual.
The residual therefore estimates the variance of epsilon, and with it the error of the direction. It
cannot show an individual error, since the part that moves the direction is the part that is fitted.

With n angles, m elements leave m - 1 - n residual phases, and m - 1 residual gains. Receivers and
transmitters that form a product array leave n_tx + n_rx - 2 - n phases of their own.

Several targets in a cell, or an extended one, leave a residual too, of another shape: with shares
f of the amplitude at small offsets delta of the angle, whose slope of phase is s,

.. math::

    \sum_j f_j e^{i s \delta_j} \approx 1 + i s \mu_1 - s^2 \mu_2 / 2,
    \quad \mu_n = \sum_j f_j \delta_j^n.

It changes steadily over the array, that of channels does not.

B. D. Steinberg, Principles of Aperture and Array System Design, 1976, 13, for the effect of random
errors of the phases on a beam.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.detection_columns import zero_where_unknown
from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.processing.angle.aperture import Aperture, radar_aperture
from dechirp.processing.angle.base import Directions
from dechirp.processing.angle.second_source_test import linearise_sources, stack_real_and_imaginary
from dechirp.radar.radar import Radar
from dechirp.theory.direction_bounds import unit_vector_derivatives

# Chance that noise alone widens the standard error of a detection. The errors of an exact array
# keep their mean square relative to the stated variance within this share.
_SIGNIFICANCE = 0.01
# Largest noise, in rad of phase in an element, of detections that describe the array: 3 degrees, of
# echoes 23 dB over noise and sidelobes.
_MAX_PHASE_NOISE_RAD = float(np.radians(3))
# Least RMS error of the phases that a finding reports: 2 degrees move a direction of an array of
# eight elements by a thousandth of its beamwidth of 13 degrees.
_MIN_REPORTED_RMS_RAD = float(np.radians(2))
# Degrees of freedom up to which the variance of Student's distribution is infinite or, from 2 to
# 2.5, more than five times that of the residual. Up to there, the variance of phases that are
# typical of boards without calibration counts as one more residual: 10 degrees.
_MAX_FREEDOM_WITH_PRIOR = 2.5
_PRIOR_PHASE_RAD = float(np.radians(10))
# Largest mean square of the residual, relative to the echo, that is due to channels: 29 degrees.
_MAX_CHANNEL_RESIDUAL = 0.25

_CALIBRATION_FIX = (
    'record a reflector at a known angle, measure the array by "dechirp calibrate REFLECTOR'
    ' --azimuth ANGLE --out cal.json", and run with --calibration cal.json'
)


class ChannelErrors(NamedTuple):
    """Phase errors of the channels by detection; zero or NaN where nothing shows them.

    Detections have at least the median of those with noise below three degrees, unless their own
    residual is smaller than that variance allows.
    """

    direction_variance_rad2: np.ndarray
    """Variance of the angles, (n, n_sources, n_angles), for the resolved angles."""
    phase_rms_rad: np.ndarray
    """RMS error of the phases of each detection with one source and noise below three degrees,
    (n,); else NaN."""


class _PlaneWaveResiduals(NamedTuple):
    """Residuals of detections with one source, after the fit of a plane wave."""

    relative: np.ndarray
    """Deviations of the amplitudes from the plane wave, relative to it, (n, n_elements)."""
    slopes: np.ndarray
    """Derivatives of the phases by the angles, of mean zero, (n, n_angles, n_elements)."""
    inverse: np.ndarray
    """Changes of the angles with the phases, (n, n_angles, n_elements): rows of J^+."""
    phase_power: np.ndarray
    gain_power: np.ndarray
    """Sums of squares of the residual phases and gains, (n,)."""
    phase_noise: np.ndarray
    """Variance of the phase of an element, (n,)."""


def estimate_channel_errors(
    snapshots: np.ndarray,
    directions: Directions,
    noise_power: np.ndarray,
    aperture: Aperture,
    wavefront_curvature_rad: Callable[[], np.ndarray] | None = None,
) -> ChannelErrors:
    """Estimate the phase errors of channels from the residuals of detections.

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
    wavefront_curvature_rad : callable, optional
        Returns the phases by which spherical waves differ from plane ones, (n, n_elements), which
        are no errors of the channels. Called if a plane wave leaves a significant residual.

    Notes
    -----
    The variance of the channels comes from few residuals, so errors over its root follow Student's
    distribution with nu degrees of freedom, whose variance nu / (nu - 2) is included. nu is the
    effective number by Satterthwaite (Biometrics Bulletin 2(6), 1946).
    """
    n_angles = sum(aperture.resolves_azimuth_and_elevation)
    variance = np.zeros((*directions.azimuth_rad.shape, n_angles))
    phase_rms = np.full(len(snapshots), np.nan)
    has_angle = np.isfinite(directions.azimuth_rad) | np.isfinite(directions.elevation_rad)
    n_sources = has_angle.sum(axis=1)
    rows = np.flatnonzero(has_angle[:, 0] & (n_sources == 1))
    n_phases, median = aperture.n_elements - 1 - n_angles, 0.0
    strongest = directions.azimuth_rad[:, 0], directions.elevation_rad[:, 0]
    angles = strongest[0][rows], strongest[1][rows]
    residuals = _fit_plane_waves(snapshots[rows], angles, noise_power[rows], aperture)
    is_significant = _has_significant_residual(residuals, n_phases)
    if wavefront_curvature_rad is not None and (
        is_significant.any() or n_sources.max(initial=0) > 1
    ):
        snapshots = _flatten_wavefronts(snapshots, wavefront_curvature_rad(), strongest, aperture)
        residuals = _fit_plane_waves(snapshots[rows], angles, noise_power[rows], aperture)
        is_significant = _has_significant_residual(residuals, n_phases)
    shows_array = residuals.phase_noise <= _MAX_PHASE_NOISE_RAD**2
    phase_rms[rows[shows_array]] = 0.0
    if is_significant.any():
        variance[rows, 0], phase_rms[rows], median = _single_source_variances(
            residuals, is_significant, shows_array, aperture.antenna_indicators
        )
    for k in range(2, int(n_sources.max(initial=0)) + 1):
        rows = np.flatnonzero(has_angle[:, :k].all(axis=1) & (n_sources == k))
        if rows.size:
            angles = directions.azimuth_rad[rows, :k], directions.elevation_rad[rows, :k]
            variance[rows, :k] = _several_source_variances(
                snapshots[rows], angles, noise_power[rows], aperture, median
            )
    return ChannelErrors(variance, phase_rms)


def _flatten_wavefronts(
    snapshots: np.ndarray,
    curvature_rad: np.ndarray,
    angles: tuple[np.ndarray, np.ndarray],
    aperture: Aperture,
) -> np.ndarray:
    """Remove the phases of curvature but for the part that is fitted as another direction."""
    azimuth, elevation = (zero_where_unknown(angle) for angle in angles)
    slopes = _phase_slopes(azimuth, elevation, aperture)
    phase = (curvature_rad - curvature_rad.mean(axis=1, keepdims=True))[:, :, None]
    fitted = slopes.swapaxes(1, 2) @ (_inverse_gram(slopes) @ (slopes @ phase))
    return np.asarray(snapshots * np.exp(-1j * (phase - fitted)[:, :, 0]))


def _inverse_gram(slopes: np.ndarray) -> np.ndarray:
    """Return the inverse of slopes (n, n_angles, n_elements) times their transpose."""
    gram = slopes @ slopes.swapaxes(1, 2)
    return np.asarray(1 / gram if gram.shape[1] == 1 else np.linalg.pinv(gram, hermitian=True))


def _fit_plane_waves(
    snapshots: np.ndarray,
    angles: tuple[np.ndarray, np.ndarray],
    noise_power: np.ndarray,
    aperture: Aperture,
) -> _PlaneWaveResiduals:
    """Return the residuals of snapshots (n, n_elements) at angles (n,) each, NaN as 0."""
    azimuth, elevation = (zero_where_unknown(angle) for angle in angles)
    relative = snapshots * aperture.steering_vectors(azimuth, elevation).conj()
    amplitude = relative.mean(axis=1)
    relative = relative / amplitude[:, None] - 1
    slopes = _phase_slopes(azimuth, elevation, aperture)
    inverse = _inverse_gram(slopes) @ slopes
    phase = relative.imag[:, :, None]
    fitted_power = np.sum((inverse @ phase) * (slopes @ phase), axis=(1, 2))
    return _PlaneWaveResiduals(
        relative,
        slopes,
        inverse,
        np.sum(relative.imag**2, axis=1) - fitted_power,
        np.sum(relative.real**2, axis=1),
        # Relative rounding errors in double precision, where there is no noise.
        np.maximum(noise_power / (2 * np.abs(amplitude) ** 2), np.finfo(float).eps ** 2),
    )


def _phase_slopes(azimuth: np.ndarray, elevation: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Return derivatives of the phases by the resolved angles, (..., n_angles, n_elements).

    Relative to the middle of the array: the mean over the elements is zero.
    """
    positions = aperture.positions - aperture.positions.mean(axis=0)
    is_resolved = np.flatnonzero(aperture.resolves_azimuth_and_elevation)
    return np.asarray(
        -2 * np.pi * unit_vector_derivatives(azimuth, elevation)[..., is_resolved, :] @ positions.T
    )


def _has_significant_residual(residuals: _PlaneWaveResiduals, n_phases: int) -> np.ndarray:
    """Return which detections, (n,), have more residual than noise has once in a hundred times."""
    n_gains = residuals.relative.shape[1] - 1
    is_significant = residuals.gain_power > residuals.phase_noise * scipy.special.chdtri(
        n_gains, _SIGNIFICANCE / 2
    )
    if n_phases > 0:
        threshold = scipy.special.chdtri(n_phases, _SIGNIFICANCE / 2)
        is_significant |= residuals.phase_power > threshold * residuals.phase_noise
    return np.asarray(is_significant)


def _single_source_variances(
    residuals: _PlaneWaveResiduals,
    is_significant: np.ndarray,
    shows_array: np.ndarray,
    antennas: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return variances of the angles, RMS phases, and the median variance of the antennas."""
    _, n_angles, n_elements = residuals.slopes.shape
    n_phases = n_elements - 1 - n_angles
    spread, is_merged = np.zeros(residuals.slopes.shape[:2]), np.zeros(len(is_significant), bool)
    spread[is_significant], is_merged[is_significant] = _angular_spread(
        _PlaneWaveResiduals(*(field[is_significant] for field in residuals))
    )
    is_channels = is_significant & ~is_merged
    responses, slopes = residuals.inverse @ antennas, residuals.slopes @ antennas
    # B^T (I - J J^+) B: the squared responses of the residual to the antennas.
    centred = antennas - antennas.mean(axis=0)
    gram = centred.T @ centred - slopes.swapaxes(1, 2) @ responses
    total = np.trace(gram, axis1=1, axis2=2)
    noise = n_phases * residuals.phase_noise
    excess = np.where(is_channels, np.maximum(residuals.phase_power - noise, 0), 0)
    antenna_variance = _divide_or_zero(excess, total, np.sum(antennas**2))
    is_of_array = shows_array & ~is_merged
    median = float(np.median(antenna_variance[is_of_array])) if is_of_array.any() else 0.0
    # Weak echoes have the errors of the array too, which their noise hides. Channels leave about
    # the same residual in all echoes: less than half of it shows that the array is better.
    strength = median * total / 2 / residuals.phase_noise
    largest_deviation = scipy.special.ndtri(1 - _SIGNIFICANCE) * np.sqrt(
        2 * (n_phases + 2 * strength)
    )
    is_below = residuals.phase_power < residuals.phase_noise * (
        n_phases + strength - largest_deviation
    )
    antenna_variance = np.where(is_below, antenna_variance, np.maximum(antenna_variance, median))
    antenna_variance = _allow_for_few_residuals(antenna_variance, gram, is_channels)
    variance = spread + antenna_variance[:, None] * np.sum(responses**2, axis=2)
    rms = np.where(is_of_array, np.sqrt(excess / max(n_phases, 1)), np.nan)
    return variance, rms, median


def _divide_or_zero(power: np.ndarray, total: np.ndarray, scale: float | np.ndarray) -> np.ndarray:
    """Return power / total; 0 where antennas leave no residual but for rounding."""
    return np.divide(power, total, out=np.zeros_like(power), where=total > 1e-9 * scale)


def _allow_for_few_residuals(
    antenna_variance: np.ndarray, gram: np.ndarray, is_significant: np.ndarray
) -> np.ndarray:
    """Return the variance of errors over an estimated standard deviation, (n,).

    By the effective number of residuals of gram (n, n_antennas, n_antennas), see
    `estimate_channel_errors`. Variances of zero stay, unless the residual is significant.
    """
    freedom = np.trace(gram, axis1=1, axis2=2) ** 2 / np.maximum(
        np.sum(gram**2, axis=(1, 2)), np.finfo(float).tiny
    )
    student = 1 + 2 / np.maximum(freedom - 2, _MAX_FREEDOM_WITH_PRIOR - 2)
    with_prior = 2 * (freedom * antenna_variance + _PRIOR_PHASE_RAD**2)
    return np.where(
        (freedom <= _MAX_FREEDOM_WITH_PRIOR) & (is_significant | (antenna_variance > 0)),
        with_prior,
        student * antenna_variance,
    )


def _angular_spread(residuals: _PlaneWaveResiduals) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean square spread of echoes in angle, (n, n_angles), and whose residual it is.

    From the part of the residual that changes steadily over the array: gains in proportion to the
    slopes s of the phases, of which |mu_1|^2 follows, and gains and phases in proportion to their
    squares, of which |mu_2| follows. The residual is due to a spread if this part is more than the
    channels have by chance (F-test), or all of it is too large for channels. The spread is zero
    elsewhere. Three elements on a line leave no other part, so only the second rule applies.
    """
    n, n_angles, n_elements = residuals.slopes.shape
    first, second = np.triu_indices(n_angles)
    scale = np.sqrt(np.mean(residuals.slopes**2, axis=2))
    slopes = residuals.slopes / scale[:, :, None]
    squares = slopes[:, first] * slopes[:, second]
    design = np.concatenate([np.ones((n, 1, n_elements)), slopes, squares], axis=1)
    inverse = np.linalg.pinv(design, rcond=1e-6)
    shares = (residuals.relative[:, None] @ inverse)[:, 0]
    rest = residuals.relative - (shares[:, None] @ design)[:, 0]
    rest_power = np.sum(np.abs(rest) ** 2, axis=1)
    total = residuals.phase_power + residuals.gain_power
    is_spread = total > _MAX_CHANNEL_RESIDUAL * n_elements
    n_squares = int(np.linalg.matrix_rank(design[0], tol=1e-6 * n_elements)) - 1 - n_angles
    n_steady = n_angles + 2 * n_squares
    n_rest = 2 * n_elements - 2 - n_angles - n_steady
    if n_rest > 0:
        rest_power = np.maximum(rest_power, n_rest * residuals.phase_noise)
        ratio = (total - rest_power) / n_steady / (rest_power / n_rest)
        is_spread |= ratio > scipy.special.fdtri(n_steady, n_rest, 1 - _SIGNIFICANCE)
    is_square = 1 + n_angles + np.flatnonzero(first == second)
    spread = (2 * np.abs(shares[:, is_square]) + shares[:, 1 : 1 + n_angles].real ** 2) / scale**2
    return np.where(is_spread[:, None], spread, 0), is_spread


def _several_source_variances(
    snapshots: np.ndarray,
    angles: tuple[np.ndarray, np.ndarray],
    noise_power: np.ndarray,
    aperture: Aperture,
    median: float,
) -> np.ndarray:
    """Return variances of the angles of k sources, (n, k, n_angles); angles (n, k) each.

    As for one source, with the amplitudes and angles of all sources fitted together, and at least
    the median variance of the antennas that echoes with one source show.
    """
    (n, k), n_elements = angles[0].shape, aperture.n_elements
    n_angles = sum(aperture.resolves_azimuth_and_elevation)
    fitted, derivatives = linearise_sources(snapshots, angles, aperture)
    design = stack_real_and_imaginary(derivatives)
    inverse = np.linalg.pinv(design)
    moved = stack_real_and_imaginary(1j * fitted[:, :, None] * aperture.antenna_indicators)
    responses = (inverse @ moved)[:, 2 * k :]
    gram = moved.swapaxes(1, 2) @ (moved - design @ (inverse @ moved))
    residual = stack_real_and_imaginary((snapshots - fitted)[:, :, None])
    residual = residual - design @ (inverse @ residual)
    power = np.sum(residual**2, axis=(1, 2))
    n_residuals = 2 * n_elements - design.shape[2]
    # Searches of directions end 120 dB below the echo, where there is no noise.
    noise = np.maximum(noise_power / 2, 1e-12 * np.mean(np.abs(fitted) ** 2, axis=1))
    total = np.trace(gram, axis1=1, axis2=2)
    is_significant = (n_residuals > 0) & (
        power > noise * scipy.special.chdtri(max(n_residuals, 1), _SIGNIFICANCE)
    )
    excess = np.where(is_significant, np.maximum(power - n_residuals * noise, 0), 0)
    scale = np.sum(np.abs(fitted) ** 2, axis=1)
    antenna_variance = np.maximum(_divide_or_zero(excess, total, scale), median)
    antenna_variance = _allow_for_few_residuals(antenna_variance, gram, is_significant)
    variance = antenna_variance[:, None] * np.sum(responses**2, axis=2)
    return np.asarray(variance.reshape(n, k, n_angles))


def median_or_nan(values: np.ndarray) -> float:
    """Return the median of the values that are not NaN; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else np.nan


def channel_error_findings(
    phase_rms_rad: Sequence[float], radar: Radar, *, resolves_two_sources: bool
) -> tuple[Finding, ...]:
    """Return a note if the channels of a radar have phases of their own.

    `phase_rms_rad` are the RMS errors of the phases in each frame, NaN where unknown. An estimator
    that does not resolve two sources in a cell may explain them by such phases.
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
            fix=_CALIBRATION_FIX
            if resolves_two_sources
            else f"{_CALIBRATION_FIX}; where two targets may share a range and a velocity, add"
            " --set chain.angle.kind=maximum-likelihood --set chain.angle.n_sources=2",
        ),
    )


def hidden_channel_error_findings(
    columns: Mapping[str, np.ndarray], phase_rms_rad: Sequence[float], radar: Radar
) -> tuple[Finding, ...]:
    """Return a note if directions of an array without calibration may hide its phases.

    Arrays of fewer than three residual phases: one or two may be small by chance. `columns` are
    those of `core.detection_columns`, for `phase_rms_rad` see `channel_error_findings`.
    """
    has_direction = np.isfinite(columns["azimuth"]) | np.isfinite(columns["elevation"])
    rms_rad = median_or_nan(np.array(phase_rms_rad))
    if radar.calibration is not None or not has_direction.any() or rms_rad >= _MIN_REPORTED_RMS_RAD:
        return ()
    aperture = radar_aperture(radar)
    n_angles, n_elements = sum(aperture.resolves_azimuth_and_elevation), aperture.n_elements
    slopes = _phase_slopes(np.zeros(1), np.zeros(1), aperture)[0]
    plane_wave = np.vstack([np.ones(n_elements), slopes]).T
    phases = np.hstack([plane_wave, aperture.antenna_indicators])
    n_phases = int(np.linalg.matrix_rank(phases)) - n_angles - 1
    if n_phases >= 3:
        return ()
    further_phases = format_count_with_noun(n_phases, "phase") if n_phases else "no phases"
    return (
        Finding(
            level="note",
            setting="chain.angle",
            value="the array is not calibrated: the standard errors of directions may contain noise"
            " alone",
            expected=f"a calibrated array, or three phases ({n_angles + 4} receivers of one"
            " transmitter) besides those of a plane wave, which show the errors of the channels:"
            f" {n_elements} elements have {further_phases}",
            fix=_CALIBRATION_FIX,
        ),
    )
