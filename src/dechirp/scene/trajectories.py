"""Trajectories of all scatterers during a frame, as polynomials of time."""

from collections.abc import Iterator
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.radar.frame import Frame
from dechirp.scene.scene import Scene

# 1e-13 m in both directions change the phase at 77 GHz by 3e-10 rad.
_TOLERANCE_M = 1e-13
# Rounding of positions relative to the coordinates that they are computed from: at most 7e-16 among
# 1e6 scatterers relative to a turning radar.
_RELATIVE_ROUNDING = 1e-15
# Largest error within one chirp, 3e-5 rad at 77 GHz.
_MAX_ERROR_M = 1e-8

# Polynomials of degree 7 through eight nodes; the error is largest between them, at _CHECKS.
_DEGREE = 7
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
_CHECKS = np.cos(np.pi * np.arange(_DEGREE + 2) / (_DEGREE + 1))
_MIDDLE_CHECK = len(_NODES) + len(_CHECKS) // 2
_THROUGH_NODES = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))
_AT_CHECKS = chebyshev.chebvander(_CHECKS, _DEGREE)
_TO_POWERS = np.array(
    [
        np.pad(row := chebyshev.cheb2poly(unit), (0, _DEGREE + 1 - len(row)))
        for unit in np.eye(_DEGREE + 1)
    ]
).T


class PolynomialPath(NamedTuple):
    """Paths of scatterers during a run of chirps, in the coordinates of the radar."""

    chirps: slice
    """Chirps of the frame, in the order sent."""
    mid_s: float
    """Middle of the run, from the start of the frame."""
    scatterers: np.ndarray
    """(n,), indices into the list of all scatterers."""
    path_m: np.ndarray
    """(n_terms, n, 3): the position at t is the sum of path_m[k] t^k, with t in s from mid_s."""


def fit_polynomial_paths(
    scene: Scene, frame: Frame, start_s: float, scatterer_mask: np.ndarray | None = None
) -> list[PolynomialPath]:
    """Fit polynomials of time to the paths of scatterers during one frame.

    Straight lines and parabolas are exact, for a radar that does not turn. Other paths are
    interpolated at Chebyshev nodes by polynomials of degree 7 at most, and compared with the
    positions between the nodes. Runs of chirps are halved, down to single chirps, for scatterers
    that are not within 1e-13 m, plus rounding of 1e-15 of coordinates and of displacements since
    time zero. A body misses that if its path has a waypoint in the middle of a chirp; errors up to
    10 nm are accepted there.

    Parameters
    ----------
    scene : Scene
        Moving targets.
    frame : Frame
        Its chirps, from the start of the first to the last sample of the last.
    start_s : float
        Start of the frame, since time zero.
    scatterer_mask : array of bool (n_scatterers,), optional
        Scatterers to include; those on parabolas are always included.

    Returns
    -------
    list of PolynomialPath
        Each included scatterer occurs once in each chirp.

    Raises
    ------
    InvalidSetting
        If a body is not finite, or its motion deviates by 10 nm within one chirp.
    """
    fitted = list(_parabolic_paths_about_mid_frame(scene, frame, start_s))
    non_polynomial = (
        scene.non_polynomial_scatterers
        if scatterer_mask is None
        else scene.non_polynomial_scatterers[scatterer_mask[scene.non_polynomial_scatterers]]
    )
    pending = [(slice(0, frame.n_chirps_total), non_polynomial)] if non_polynomial.size else []
    while pending:
        chirps, scatterers = pending.pop()
        path, is_close = _fit_polynomial_with_accuracy_mask(
            scene, frame, start_s, chirps, scatterers
        )
        if is_close.any():
            fitted.append(path)
        remaining = scatterers[~is_close]
        if remaining.size:
            middle = (chirps.start + chirps.stop) // 2
            pending.append((slice(middle, chirps.stop), remaining))
            pending.append((slice(chirps.start, middle), remaining))
    return fitted


def _fit_polynomial_with_accuracy_mask(
    scene: Scene, frame: Frame, start_s: float, chirps: slice, scatterers: np.ndarray
) -> tuple[PolynomialPath, np.ndarray]:
    """Return the paths that a single polynomial approximates, and a mask of these scatterers."""
    mid_s, half_s = _chirp_run_middle_and_half_s(frame, chirps)
    times_s = start_s + mid_s + half_s * np.concatenate([_NODES, _CHECKS])
    targets = np.unique(scene.target_index_of_scatterer[scatterers])
    target_scatterers = np.flatnonzero(np.isin(scene.target_index_of_scatterer, targets))
    positions_m = scene.scatterer_positions_m(times_s, targets)[
        :, np.searchsorted(target_scatterers, scatterers)
    ]
    middle_m = positions_m[_MIDDLE_CHECK]
    # Displacements from the middle are short and keep their digits.
    displacement_m = positions_m - middle_m
    series_m = np.tensordot(_THROUGH_NODES, displacement_m[: len(_NODES)], axes=1)
    residual_m = displacement_m[len(_NODES) :] - np.tensordot(_AT_CHECKS, series_m, axes=1)
    error_m = np.linalg.norm(residual_m, axis=-1).max(axis=0)
    sizes_m = np.linalg.norm(series_m, axis=-1)
    tolerance_m = _position_tolerances_m(
        scene, scatterers, middle_m, sizes_m, half_s, times_s[len(_NODES)]
    )
    is_close = error_m <= tolerance_m
    if chirps.stop - chirps.start == 1:
        is_close |= error_m <= _MAX_ERROR_M
        _check_fit_errors(scene, scatterers, error_m, is_close, start_s + mid_s)
    # Terms that no scatterer needs are omitted: terms from k on add up to tails_m[k].
    tails_m = np.cumsum(sizes_m[::-1], axis=0)[::-1]
    n_terms = 1 + np.flatnonzero((tails_m > tolerance_m / 2)[:, is_close].any(axis=1)).max(
        initial=0
    )
    terms_m = np.tensordot(_TO_POWERS[:n_terms, :n_terms], series_m[:n_terms, is_close], axes=1)
    path_m = terms_m / half_s ** np.arange(n_terms)[:, None, None]
    path_m[0] += middle_m[is_close]
    return PolynomialPath(chirps, mid_s, scatterers[is_close], path_m), is_close


def _position_tolerances_m(
    scene: Scene,
    scatterers: np.ndarray,
    middle_m: np.ndarray,
    sizes_m: np.ndarray,
    half_s: float,
    end_s: float,
) -> np.ndarray:
    """Return the tolerance of each scatterer's position, (n,), set by rounding.

    Rounding affects its coordinates now and at time zero, and, at late times, the time itself:
    positions change by the speed times the rounding of the time.
    """
    distance_m = np.linalg.norm(middle_m, axis=-1)
    start_m = np.linalg.norm(scene.target_offsets_from_radar_m([0.0])[0], axis=-1)[
        scene.target_index_of_scatterer[scatterers]
    ]
    # The slope of the Chebyshev polynomial k is at most k^2.
    speed = np.arange(_DEGREE + 1) ** 2 @ sizes_m / half_s
    ego = scene.ego
    speed += np.linalg.norm(ego.velocity_m_per_s) + abs(ego.turn_rate_rad_per_s) * distance_m
    return _TOLERANCE_M + _RELATIVE_ROUNDING * (np.maximum(distance_m, start_m) + end_s * speed)


def _check_fit_errors(
    scene: Scene,
    scatterers: np.ndarray,
    error_m: np.ndarray,
    is_close: np.ndarray,
    time_s: float,
) -> None:
    if is_close.all():
        return
    worst = int(np.argmax(np.where(is_close, 0.0, error_m)))
    name = scene.names[scene.target_index_of_scatterer[scatterers[worst]]]
    raise InvalidSetting(
        f"scene.targets.{name}",
        value=f"a motion in the chirp at {format_si(time_s, 's')} that deviates by"
        f" {error_m[worst]:.2g} m"
        f" from a polynomial of degree {_DEGREE}",
        expected=f"a deviation of at most {_MAX_ERROR_M:g} m in each chirp",
        fix="slow down the parts of the body, or give it a heading",
    )


def _parabolic_paths_about_mid_frame(
    scene: Scene, frame: Frame, start_s: float
) -> Iterator[PolynomialPath]:
    scatterers, coefficients_m = scene.parabolic_paths
    if not scatterers.size:
        return
    chirps = slice(0, frame.n_chirps_total)
    mid_s, _ = _chirp_run_middle_and_half_s(frame, chirps)
    mid_time_s, path_m = start_s + mid_s, coefficients_m.copy()
    for k in range(len(coefficients_m)):
        for j in range(k + 1, len(coefficients_m)):
            path_m[k] += comb(j, k) * mid_time_s ** (j - k) * coefficients_m[j]
    yield PolynomialPath(chirps, mid_s, scatterers, path_m)


def _chirp_run_middle_and_half_s(frame: Frame, chirps: slice) -> tuple[float, float]:
    """Return the middle of a run, from the start of the frame, and half of its length."""
    chirp = frame.chirp
    first_s, last_s = frame.chirp_starts_s[[chirps.start, chirps.stop - 1]]
    end_s = last_s + chirp.adc_start_s + chirp.sampled_duration_s
    return (first_s + end_s) / 2, (end_s - first_s) / 2
