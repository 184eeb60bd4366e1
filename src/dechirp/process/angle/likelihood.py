"""Directions by likelihood: amplitudes, standard errors, and the maximum near given directions.

Sources are unknown numbers in white noise, so the likelihood of directions is what least
squares leave of the snapshots (the conditional or deterministic model).
"""

from typing import NamedTuple

import numba
import numpy as np

from dechirp.process.angle.aperture import Aperture
from dechirp.theory.direction_bounds import variances

# Of the squared length of a steering vector, so that two sources at one place have amplitudes.
_RIDGE = 1e-9
_MOST_ITERATIONS = 20
# Of a grid step: a beam has eight, and at 20 dB an error is a hundred times larger.
_CLOSE = 1e-4


class Search(NamedTuple):
    """What the climb to a maximum knows of the array."""

    positions: np.ndarray
    """(n_elements, 3)."""
    told: np.ndarray
    """(n_told,) which of azimuth and elevation are sought."""
    limit: np.ndarray
    """(n_told,) largest sines."""
    close: np.ndarray
    """(n_told,) steps of sines that are the last."""


def powers(
    snapshots: np.ndarray, aperture: Aperture, azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> np.ndarray:
    """Mean powers over the looks of the sources at directions, (n, most), by least squares.

    `snapshots` (n, n_looks, n_elements), directions (n, most), NaN where there are fewer.
    """
    return _of_all(*_prepared(snapshots, aperture, azimuth_rad, elevation_rad))[0]


def standard_errors(
    snapshots: np.ndarray,
    aperture: Aperture,
    noise_power: np.ndarray,
    azimuth_rad: np.ndarray,
    elevation_rad: np.ndarray,
) -> np.ndarray:
    """Cramer-Rao bounds at estimated directions and amplitudes, (n, most, n_told) in rad.

    For the angles that the array tells, azimuth before elevation; see
    `theory.direction_bounds.conditional_information`.
    """
    _, information = _of_all(*_prepared(snapshots, aperture, azimuth_rad, elevation_rad))
    variance = variances(information).reshape(*azimuth_rad.shape, sum(aperture.tells))
    std = np.sqrt(variance * noise_power[:, None, None])
    return np.where(np.isnan(azimuth_rad)[..., None], np.nan, std)


def maximised(
    snapshots: np.ndarray, aperture: Aperture, azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Directions of greatest likelihood near given ones, all sources of a snapshot together.

    Levenberg and Marquardt's steps on what least squares leave, in sines of the angles, within
    the field of view; of one source the top of the beam that looks at it, of several the place
    where none leaks into another. Arrays as in `powers`; returns azimuths and elevations.
    """
    data, positions, told, angles = _prepared(snapshots, aperture, azimuth_rad, elevation_rad)
    limit = np.array(aperture.field_of_view.sines)[told]
    close = _CLOSE * np.array(aperture.steps)[told]
    angles = np.arcsin(_maximised(data, np.sin(angles), Search(positions, told, limit, close)))
    return angles[..., 0], angles[..., 1]


def _prepared(
    snapshots: np.ndarray, aperture: Aperture, azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Snapshots, places, indices of the angles told, directions (n, most, 2): for compiled code."""
    angles = np.stack([azimuth_rad, elevation_rad], axis=-1)
    data = np.ascontiguousarray(snapshots, complex)
    return data, aperture.positions, np.flatnonzero(aperture.tells), angles


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _of_all(
    snapshots: np.ndarray, positions: np.ndarray, told: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean powers (n, most), and information on the angles, (n, most x n_told, the same).

    NaN, and rows of the identity, where there are fewer.
    """
    n, most, _ = angles.shape
    n_told = len(told)
    power = np.full((n, most), np.nan)
    information = np.zeros((n, most * n_told, most * n_told))
    for i in range(n):
        known = np.flatnonzero(~np.isnan(angles[i, :, 0]))
        for j in range(most * n_told):
            information[i, j, j] = 1.0
        if known.size == 0:
            continue
        amplitudes, _, found, _ = _fit(snapshots[i], positions, told, angles[i][known])
        for j in range(known.size * n_told):
            row = known[j // n_told] * n_told + j % n_told
            for k in range(known.size * n_told):
                information[i, row, known[k // n_told] * n_told + k % n_told] = 2 * found[j, k]
        for j in range(known.size):
            power[i, known[j]] = np.mean(np.abs(amplitudes[j]) ** 2)
    return power, information


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _maximised(snapshots: np.ndarray, sines: np.ndarray, search: Search) -> np.ndarray:
    """Sines (n, most, 2) after Levenberg and Marquardt's steps."""
    out = sines.copy()
    for i in range(len(sines)):
        known = np.flatnonzero(~np.isnan(sines[i, :, 0]))
        if known.size:
            out[i][known] = _climbed(snapshots[i], sines[i][known], search)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _climbed(snapshots: np.ndarray, sines: np.ndarray, search: Search) -> np.ndarray:
    """Sines (k, 2) of the sources of one detection after the steps."""
    positions, told, limit, close = search
    at, still = sines, np.zeros((len(sines), len(told)))
    at = _moved(at, still, told, limit)
    gradient, information, left = _slope(snapshots, positions, told, at)
    damping = 1e-3
    for _ in range(_MOST_ITERATIONS):
        curve = information.copy()
        for j in range(len(curve)):
            # A snapshot of zeros stays where it is.
            curve[j, j] = curve[j, j] * (1 + damping) + 1e-300
        step = np.linalg.solve(curve, gradient).reshape(still.shape)
        tried = _moved(at, step, told, limit)
        is_far = False
        for p in range(len(told)):
            is_far |= np.abs(tried[:, told[p]] - at[:, told[p]]).max() > close[p]
        found = _slope(snapshots, positions, told, tried)
        damping *= 0.1 if found[2] <= left else 10.0
        if found[2] <= left:
            at = tried
            gradient, information, left = found
        if not is_far:
            break
    return at


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moved(sines: np.ndarray, step: np.ndarray, told: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Sines (k, 2) moved by a step (k, n_told), within the field of view."""
    out = sines.copy()
    for j in range(len(sines)):
        for p in range(len(told)):
            out[j, told[p]] = min(max(sines[j, told[p]] + step[j, p], -limit[p]), limit[p])
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _slope(
    snapshots: np.ndarray, positions: np.ndarray, told: np.ndarray, sines: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Slope and curvature of the log-likelihood in the sines, and the energy that is left."""
    angles = np.arcsin(sines)
    _, gradient, information, left = _fit(snapshots, positions, told, angles)
    n_told = len(told)
    for j in range(gradient.size):
        slope = np.cos(angles[j // n_told, told[j % n_told]])
        gradient[j] /= slope
        information[j] /= slope
        information[:, j] /= slope
    return gradient, information, left


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _fit(
    snapshots: np.ndarray, positions: np.ndarray, told: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Least squares of k sources at directions (k, 2) to one detection, (n_looks, n_elements).

    Returns amplitudes (k, n_looks), and per angle told the slope of the log-likelihood and its
    curvature, (k x n_told) and its square, at a noise power of 2; and the energy that is left.
    By Gram and Schmidt's orthogonal vectors, each taken out of all that follow: later steering
    vectors, derivatives, snapshots. The ridge is one element more for each source.
    """
    k, n_told, n_looks, n = len(angles), len(told), len(snapshots), len(positions)
    first_slope, first_look = k, k + k * n_told
    rows = np.zeros((first_look + n_looks, n + k), np.complex128)
    rows[first_look:, :n] = snapshots
    for j in range(k):
        _steer(rows[j], rows[first_slope + j * n_told :], positions, told, angles[j])
        rows[j, n + j] = np.sqrt(_RIDGE * n)
    triangle = np.zeros((k, first_look + n_looks), np.complex128)
    for j in range(k):
        own = rows[j]
        triangle[j, j] = np.sqrt(_product(own, own).real)
        own /= triangle[j, j]
        for later in range(j + 1, len(rows)):
            share = triangle[j, later] = _product(own, rows[later])
            for e in range(own.size):
                rows[later, e] -= share * own[e]
    amplitudes = triangle[:, first_look:].copy()
    for j in range(k - 1, -1, -1):
        for later in range(j + 1, k):
            amplitudes[j] -= triangle[j, later] * amplitudes[later]
        amplitudes[j] /= triangle[j, j]
    slopes, looks = rows[first_slope:first_look], rows[first_look:]
    gradient = np.zeros(k * n_told)
    information = np.empty((k * n_told, k * n_told))
    for a in range(k * n_told):
        for look in range(n_looks):
            towards = _product(slopes[a], looks[look])
            gradient[a] += (towards * np.conj(amplitudes[a // n_told, look])).real
        for b in range(a + 1):
            of_both = _product(amplitudes[b // n_told], amplitudes[a // n_told])
            information[a, b] = (_product(slopes[a], slopes[b]) * np.conj(of_both)).real
            information[b, a] = information[a, b]
    left = 0.0
    for look in range(n_looks):
        left += _product(looks[look, :n], looks[look, :n]).real
    return amplitudes, gradient, information, left


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _steer(
    steering: np.ndarray,
    slopes: np.ndarray,
    positions: np.ndarray,
    told: np.ndarray,
    angles: np.ndarray,
) -> None:
    """Fill in `Aperture.steering` of a direction, and its derivatives, a row for each angle."""
    (left, up), (forward, level) = np.sin(angles), np.cos(angles)
    towards = (level * forward, level * left, up)
    by_angle = ((-level * left, level * forward, 0.0), (-up * forward, -up * left, level))
    for e in range(len(positions)):
        x, y, z = positions[e]
        phase = -2 * np.pi * (towards[0] * x + towards[1] * y + towards[2] * z)
        steering[e] = complex(np.cos(phase), np.sin(phase))
        for p in range(len(told)):
            along = by_angle[told[p]]
            turn = -2 * np.pi * (along[0] * x + along[1] * y + along[2] * z)
            slopes[p, e] = 1j * turn * steering[e]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _product(left: np.ndarray, right: np.ndarray) -> complex:
    """Inner product, the first one conjugated."""
    real, imaginary = 0.0, 0.0
    for e in range(left.size):
        a, b = left[e], right[e]
        real += a.real * b.real + a.imag * b.imag
        imaginary += a.real * b.imag - a.imag * b.real
    return complex(real, imaginary)
