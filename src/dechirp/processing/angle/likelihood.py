"""Likelihood of directions: amplitudes, standard errors, and a local maximum.

Sources are unknown amplitudes in white noise, so the likelihood of directions is the residual of
least squares (the conditional or deterministic model).
"""

from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.processing.angle.aperture import Aperture
from dechirp.theory.direction_bounds import crlb_variances

# Relative to the squared norm of a steering vector, so that coincident sources have amplitudes.
_RIDGE = 1e-9
_MOST_ITERATIONS = 20
# Share of a grid step: a beam has eight, and the error at 20 dB is a hundred times larger.
_TOLERANCE = 1e-4


class Search(NamedTuple):
    """Parameters of the search for a maximum."""

    positions: np.ndarray
    """Element positions (n_elements, 3)."""
    resolved_axes: np.ndarray
    """Indices (n_angles,) of the angles to estimate: 0 azimuth, 1 elevation."""
    limit: np.ndarray
    """Largest sines, (n_angles,)."""
    tolerance: np.ndarray
    """Steps of sines at which the search ends, (n_angles,)."""


def least_squares_source_powers(
    snapshots: np.ndarray, aperture: Aperture, azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> np.ndarray:
    """Return least-squares powers of sources at directions, (n, n_sources).

    They are means over the snapshots. `snapshots` (n, n_snapshots, n_elements), directions (n,
    most), NaN where there are fewer.
    """
    return _source_powers_and_fisher_information(
        *_convert_to_compiled_kernel_arrays(snapshots, aperture, azimuth_rad, elevation_rad)
    )[0]


def crlb_standard_errors(
    snapshots: np.ndarray,
    aperture: Aperture,
    noise_power: np.ndarray,
    azimuth_rad: np.ndarray,
    elevation_rad: np.ndarray,
) -> np.ndarray:
    """Return Cramer-Rao bounds at estimated directions and amplitudes, in rad.

    (n, n_sources, n_angles) for the resolved angles, azimuth before elevation; see
    `theory.direction_bounds.conditional_fisher_information`.
    """
    _, information = _source_powers_and_fisher_information(
        *_convert_to_compiled_kernel_arrays(snapshots, aperture, azimuth_rad, elevation_rad)
    )
    variance = crlb_variances(information).reshape(
        *azimuth_rad.shape, sum(aperture.resolves_azimuth_and_elevation)
    )
    with np.errstate(invalid="ignore"):  # no noise, and sources that cannot be resolved
        std = np.sqrt(variance * noise_power[:, None, None])
    return np.where(np.isnan(azimuth_rad)[..., None], np.nan, std)


def maximise_direction_likelihood(
    snapshots: np.ndarray,
    aperture: Aperture,
    start_azimuth_rad: np.ndarray,
    start_elevation_rad: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Maximise the likelihood of all sources of each detection near given directions.

    Levenberg-Marquardt steps on the least-squares residual, in sines of the angles, within the
    field of view. For a single source this is the top of its beam; for several, the sources do
    not bias each other. Arrays as in `least_squares_source_powers`; returns azimuths and
    elevations.
    """
    data, positions, resolved_axes, angles = _convert_to_compiled_kernel_arrays(
        snapshots, aperture, start_azimuth_rad, start_elevation_rad
    )
    limit = np.array(aperture.field_of_view.max_angle_sines)[resolved_axes]
    tolerance = _TOLERANCE * np.array(aperture.direction_grid_sine_steps)[resolved_axes]
    angles = np.arcsin(
        _maximise_likelihood_of_detections(
            data, np.sin(angles), Search(positions, resolved_axes, limit, tolerance)
        )
    )
    return angles[..., 0], angles[..., 1]


def _convert_to_compiled_kernel_arrays(
    snapshots: np.ndarray, aperture: Aperture, azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return snapshots, positions, resolved axes and directions as arrays for compiled code."""
    angles = np.stack([azimuth_rad, elevation_rad], axis=-1)
    data = np.ascontiguousarray(snapshots, complex)
    return data, aperture.positions, np.flatnonzero(aperture.resolves_azimuth_and_elevation), angles


@kernel(plain=AS_WRITTEN)
def _source_powers_and_fisher_information(
    snapshots: np.ndarray, positions: np.ndarray, resolved_axes: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean powers and information on the angles of each detection.

    (n, n_sources) and (n, n_sources x n_angles, the same); NaN, and rows of the identity, where
    there are fewer sources.
    """
    n, most, _ = angles.shape
    n_angles = len(resolved_axes)
    power = np.full((n, most), np.nan)
    information = np.zeros((n, most * n_angles, most * n_angles))
    for i in range(n):
        sources = np.flatnonzero(~np.isnan(angles[i, :, 0]))
        for j in range(most * n_angles):
            information[i, j, j] = 1.0
        if sources.size == 0:
            continue
        amplitudes, _, curvature, _ = _fit_amplitudes_and_derivatives(
            snapshots[i], positions, resolved_axes, angles[i][sources]
        )
        for j in range(sources.size * n_angles):
            row = sources[j // n_angles] * n_angles + j % n_angles
            for k in range(sources.size * n_angles):
                information[i, row, sources[k // n_angles] * n_angles + k % n_angles] = (
                    2 * curvature[j, k]
                )
        for j in range(sources.size):
            power[i, sources[j]] = np.mean(np.abs(amplitudes[j]) ** 2)
    return power, information


@kernel(plain=AS_WRITTEN)
def _maximise_likelihood_of_detections(
    snapshots: np.ndarray, start_sines: np.ndarray, search: Search
) -> np.ndarray:
    """Return sines (n, n_sources, 2) after Levenberg-Marquardt steps."""
    out = start_sines.copy()
    for i in range(len(start_sines)):
        sources = np.flatnonzero(~np.isnan(start_sines[i, :, 0]))
        if sources.size:
            out[i][sources] = _maximise_likelihood_of_detection(
                snapshots[i], start_sines[i][sources], search
            )
    return out


@kernel(plain=AS_WRITTEN)
def _maximise_likelihood_of_detection(
    snapshots: np.ndarray, start_sines: np.ndarray, search: Search
) -> np.ndarray:
    """Return sines (k, 2) of the sources of one detection after Levenberg-Marquardt steps."""
    positions, resolved_axes, limit, tolerance = search
    current, no_step = start_sines, np.zeros((len(start_sines), len(resolved_axes)))
    current = _add_step_within_view(current, no_step, resolved_axes, limit)
    gradient, information, residual = _gradient_curvature_and_residual(
        snapshots, positions, resolved_axes, current
    )
    damping = 1e-3
    for _ in range(_MOST_ITERATIONS):
        damped = information.copy()
        for j in range(len(damped)):
            # The addition keeps a snapshot of zeros in place.
            damped[j, j] = damped[j, j] * (1 + damping) + 1e-300
        step = np.linalg.solve(damped, gradient).reshape(no_step.shape)
        trial = _add_step_within_view(current, step, resolved_axes, limit)
        is_far = False
        for p in range(len(resolved_axes)):
            is_far |= (
                np.abs(trial[:, resolved_axes[p]] - current[:, resolved_axes[p]]).max()
                > tolerance[p]
            )
        trial_fit = _gradient_curvature_and_residual(snapshots, positions, resolved_axes, trial)
        damping *= 0.1 if trial_fit[2] <= residual else 10.0
        if trial_fit[2] <= residual:
            current = trial
            gradient, information, residual = trial_fit
        if not is_far:
            break
    return current


@kernel(plain=AS_WRITTEN)
def _add_step_within_view(
    sines: np.ndarray, step: np.ndarray, resolved_axes: np.ndarray, max_sines: np.ndarray
) -> np.ndarray:
    """Add a step (k, n_angles) to sines (k, 2), within the field of view."""
    out = sines.copy()
    for j in range(len(sines)):
        for p in range(len(resolved_axes)):
            out[j, resolved_axes[p]] = min(
                max(sines[j, resolved_axes[p]] + step[j, p], -max_sines[p]), max_sines[p]
            )
    return out


@kernel(plain=AS_WRITTEN)
def _gradient_curvature_and_residual(
    snapshots: np.ndarray, positions: np.ndarray, resolved_axes: np.ndarray, sines: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return gradient and curvature of the log-likelihood in the sines, and the residual energy."""
    angles = np.arcsin(sines)
    _, gradient, information, residual = _fit_amplitudes_and_derivatives(
        snapshots, positions, resolved_axes, angles
    )
    n_angles = len(resolved_axes)
    for j in range(gradient.size):
        slope = np.cos(angles[j // n_angles, resolved_axes[j % n_angles]])
        gradient[j] /= slope
        information[j] /= slope
        information[:, j] /= slope
    return gradient, information, residual


@kernel(plain=AS_WRITTEN, fastmath={"contract", "reassoc"})
def _fit_amplitudes_and_derivatives(
    snapshots: np.ndarray, positions: np.ndarray, resolved_axes: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Fit k sources at directions (k, 2) to a detection (n_snapshots, n_elements).

    Returns least-squares amplitudes (k, n_snapshots), gradient (k x n_angles) and curvature of the
    log-likelihood in the angles at a noise power of 2, and the residual energy. Gram-Schmidt
    orthogonalisation projects each steering vector out of all rows that follow: later steering
    vectors, derivatives, snapshots. The ridge is one extra element for each source.
    """
    k, n_angles, n_snapshots, n = len(angles), len(resolved_axes), len(snapshots), len(positions)
    first_slope, first_snapshot = k, k + k * n_angles
    rows = np.zeros((first_snapshot + n_snapshots, n + k), np.complex128)
    rows[first_snapshot:, :n] = snapshots
    for j in range(k):
        _write_steering_and_derivatives(
            rows[j], rows[first_slope + j * n_angles :], positions, resolved_axes, angles[j]
        )
        rows[j, n + j] = np.sqrt(_RIDGE * n)
    triangle = np.zeros((k, first_snapshot + n_snapshots), np.complex128)
    for j in range(k):
        pivot_row = rows[j]
        triangle[j, j] = np.sqrt(_inner_product(pivot_row, pivot_row).real)
        pivot_row /= triangle[j, j]
        for later in range(j + 1, len(rows)):
            share = triangle[j, later] = _inner_product(pivot_row, rows[later])
            for e in range(pivot_row.size):
                rows[later, e] -= share * pivot_row[e]
    amplitudes = triangle[:, first_snapshot:].copy()
    for j in range(k - 1, -1, -1):
        for later in range(j + 1, k):
            amplitudes[j] -= triangle[j, later] * amplitudes[later]
        amplitudes[j] /= triangle[j, j]
    slopes, snapshot_rows = rows[first_slope:first_snapshot], rows[first_snapshot:]
    gradient = np.zeros(k * n_angles)
    information = np.empty((k * n_angles, k * n_angles))
    for a in range(k * n_angles):
        for snapshot in range(n_snapshots):
            correlation = _inner_product(slopes[a], snapshot_rows[snapshot])
            gradient[a] += (correlation * np.conj(amplitudes[a // n_angles, snapshot])).real
        for b in range(a + 1):
            cross_power = _inner_product(amplitudes[b // n_angles], amplitudes[a // n_angles])
            information[a, b] = (_inner_product(slopes[a], slopes[b]) * np.conj(cross_power)).real
            information[b, a] = information[a, b]
    residual = 0.0
    for snapshot in range(n_snapshots):
        residual += _inner_product(snapshot_rows[snapshot, :n], snapshot_rows[snapshot, :n]).real
    return amplitudes, gradient, information, residual


@kernel(plain=AS_WRITTEN)
def _write_steering_and_derivatives(
    steering: np.ndarray,
    derivatives: np.ndarray,
    positions: np.ndarray,
    resolved_axes: np.ndarray,
    angles: np.ndarray,
) -> None:
    """Fill in the steering vector of a direction, and its derivatives, a row for each angle."""
    (sin_azimuth, sin_elevation), (cos_azimuth, cos_elevation) = np.sin(angles), np.cos(angles)
    unit_vector = (cos_elevation * cos_azimuth, cos_elevation * sin_azimuth, sin_elevation)
    unit_vector_slopes = (
        (-cos_elevation * sin_azimuth, cos_elevation * cos_azimuth, 0.0),
        (-sin_elevation * cos_azimuth, -sin_elevation * sin_azimuth, cos_elevation),
    )
    for e in range(len(positions)):
        x, y, z = positions[e]
        phase = -2 * np.pi * (unit_vector[0] * x + unit_vector[1] * y + unit_vector[2] * z)
        steering[e] = complex(np.cos(phase), np.sin(phase))
        for p in range(len(resolved_axes)):
            slope = unit_vector_slopes[resolved_axes[p]]
            phase_slope = -2 * np.pi * (slope[0] * x + slope[1] * y + slope[2] * z)
            derivatives[p, e] = 1j * phase_slope * steering[e]


@kernel(plain=np.vdot, fastmath={"contract", "reassoc"})
def _inner_product(first: np.ndarray, second: np.ndarray) -> complex:
    """Return the inner product, the first vector conjugated."""
    real, imaginary = 0.0, 0.0
    for e in range(first.size):
        a, b = first[e], second[e]
        real += a.real * b.real + a.imag * b.imag
        imaginary += a.real * b.imag - a.imag * b.real
    return complex(real, imaginary)
