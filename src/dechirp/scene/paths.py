"""Paths of all scatterers during a frame, as polynomials of time."""

from collections.abc import Iterator
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from dechirp.core.errors import InvalidSetting
from dechirp.radar.frame import Frame
from dechirp.scene.scene import Scene

# 1e-13 m, there and back, turn the phase at 77 GHz by 3e-10 rad.
_CLOSE_M = 1e-13
# Roundings of positions, over the coordinates that they are computed from: 7e-16 at most
# among 1e6 scatterers seen by a radar that turns.
_ROUNDINGS = 1e-15
# Within one chirp, 3e-5 rad at 77 GHz; beyond, a path is refused.
_TOO_FAR_M = 1e-8

# Polynomials of degree 7 through eight nodes; the error is largest between them, at _CHECKS.
_DEGREE = 7
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
_CHECKS = np.cos(np.pi * np.arange(_DEGREE + 2) / (_DEGREE + 1))
_MIDDLE = len(_NODES) + len(_CHECKS) // 2
_THROUGH_NODES = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))
_AT_CHECKS = chebyshev.chebvander(_CHECKS, _DEGREE)
_TO_POWERS = np.array(
    [
        np.pad(row := chebyshev.cheb2poly(unit), (0, _DEGREE + 1 - len(row)))
        for unit in np.eye(_DEGREE + 1)
    ]
).T


class Path(NamedTuple):
    """Scatterers during a run of chirps, in the coordinates of the radar."""

    chirps: slice
    """Of the frame, in the order sent."""
    mid_s: float
    """Middle of the run, from the start of the frame."""
    scatterers: np.ndarray
    """(n,), places in the list of all scatterers."""
    path_m: np.ndarray
    """(n_terms, n, 3): at t they are where the sum of path_m[k] t^k says, t in s from mid_s."""


def paths(scene: Scene, frame: Frame, start_s: float, seen: np.ndarray | None = None) -> list[Path]:
    """Polynomials in time along which scatterers go during one frame.

    Straight lines and parabolas are exact, for a radar that does not turn. Anything else is
    interpolated at Chebyshev's nodes by polynomials of degree 7 at most. They are held
    against the positions between the nodes, and chirps are halved into shorter runs, down to
    single ones, for those scatterers that are not within 1e-13 m, plus roundings of 1e-15 of
    coordinates and of ways since time zero. A body is not within that where its path has a
    waypoint in the middle of a chirp; what is within 10 nm is taken there.

    Parameters
    ----------
    scene : Scene
        What moves.
    frame : Frame
        Its chirps, from the start of the first to the last sample of the last.
    start_s : float
        When the frame starts, since time zero.
    seen : array of bool (n_scatterers,), optional
        Only where these are is asked for; those on parabolas come all the same.

    Returns
    -------
    list of Path
        Every scatterer that is asked for is in each chirp once.

    Raises
    ------
    InvalidSetting
        If a body is not finite, or moves so wildly that it is 10 nm off within one chirp.
    """
    found = list(_parabolas(scene, frame, start_s))
    others = scene.wanderers if seen is None else scene.wanderers[seen[scene.wanderers]]
    waiting = [(slice(0, frame.n_sent), others)] if others.size else []
    while waiting:
        chirps, scatterers = waiting.pop()
        path, is_close = _interpolated(scene, frame, start_s, chirps, scatterers)
        if is_close.any():
            found.append(path)
        left = scatterers[~is_close]
        if left.size:
            middle = (chirps.start + chirps.stop) // 2
            waiting.append((slice(middle, chirps.stop), left))
            waiting.append((slice(chirps.start, middle), left))
    return found


def _interpolated(
    scene: Scene, frame: Frame, start_s: float, chirps: slice, scatterers: np.ndarray
) -> tuple[Path, np.ndarray]:
    """Path of those scatterers that one polynomial follows, and which of them those are."""
    mid_s, half_s = _span_s(frame, chirps)
    times_s = start_s + mid_s + half_s * np.concatenate([_NODES, _CHECKS])
    targets = np.unique(scene.owners[scatterers])
    of_targets = np.flatnonzero(np.isin(scene.owners, targets))
    at_m = scene.positions_m(times_s, targets)[:, np.searchsorted(of_targets, scatterers)]
    middle_m = at_m[_MIDDLE]
    # From the middle on, ways are short and keep their digits.
    way_m = at_m - middle_m
    series_m = np.tensordot(_THROUGH_NODES, way_m[: len(_NODES)], axes=1)
    left_m = way_m[len(_NODES) :] - np.tensordot(_AT_CHECKS, series_m, axes=1)
    error_m = np.linalg.norm(left_m, axis=-1).max(axis=0)
    sizes_m = np.linalg.norm(series_m, axis=-1)
    close_m = _close_m(scene, scatterers, middle_m, sizes_m, half_s, times_s[len(_NODES)])
    is_close = error_m <= close_m
    if chirps.stop - chirps.start == 1:
        is_close |= error_m <= _TOO_FAR_M
        _must_be_close(scene, scatterers, error_m, is_close, start_s + mid_s)
    # Terms that no scatterer needs are left out: what follows term k adds up to tails_m[k].
    tails_m = np.cumsum(sizes_m[::-1], axis=0)[::-1]
    n_terms = 1 + np.flatnonzero((tails_m > close_m / 2)[:, is_close].any(axis=1)).max(initial=0)
    terms_m = np.tensordot(_TO_POWERS[:n_terms, :n_terms], series_m[:n_terms, is_close], axes=1)
    path_m = terms_m / half_s ** np.arange(n_terms)[:, None, None]
    path_m[0] += middle_m[is_close]
    return Path(chirps, mid_s, scatterers[is_close], path_m), is_close


def _close_m(
    scene: Scene,
    scatterers: np.ndarray,
    middle_m: np.ndarray,
    sizes_m: np.ndarray,
    half_s: float,
    end_s: float,
) -> np.ndarray:
    """How near a polynomial must come to each scatterer, (n,): to roundings of its position.

    Those are of its coordinates now and at time zero, and, late, of the times: positions
    move by the speed times the rounding of the time.
    """
    far_m = np.linalg.norm(middle_m, axis=-1)
    start_m = np.linalg.norm(scene.from_radar_m([0.0])[0], axis=-1)[scene.owners[scatterers]]
    # The slope of Chebyshev's polynomial k is k^2 at most.
    speed = np.arange(_DEGREE + 1) ** 2 @ sizes_m / half_s
    ego = scene.ego
    speed += np.linalg.norm(ego.velocity_m_per_s) + abs(ego.turn_rate_rad_per_s) * far_m
    return _CLOSE_M + _ROUNDINGS * (np.maximum(far_m, start_m) + end_s * speed)


def _must_be_close(
    scene: Scene,
    scatterers: np.ndarray,
    error_m: np.ndarray,
    is_close: np.ndarray,
    time_s: float,
) -> None:
    if is_close.all():
        return
    worst = int(np.argmax(np.where(is_close, 0.0, error_m)))
    name = scene.names[scene.owners[scatterers[worst]]]
    raise InvalidSetting(
        f"scene.targets.{name}",
        got=f"moving so wildly in the chirp at {time_s:.6g} s that a polynomial of degree"
        f" {_DEGREE} is {error_m[worst]:.2g} m off",
        need=f"within {_TOO_FAR_M:g} m of one in each chirp",
        fix="Let its parts move more slowly, or give the body a heading.",
    )


def _parabolas(scene: Scene, frame: Frame, start_s: float) -> Iterator[Path]:
    scatterers, terms_m = scene.parabolas
    if not scatterers.size:
        return
    chirps = slice(0, frame.n_sent)
    mid_s, _ = _span_s(frame, chirps)
    at_s, path_m = start_s + mid_s, terms_m.copy()
    for k in range(len(terms_m)):
        for j in range(k + 1, len(terms_m)):
            path_m[k] += comb(j, k) * at_s ** (j - k) * terms_m[j]
    yield Path(chirps, mid_s, scatterers, path_m)


def _span_s(frame: Frame, chirps: slice) -> tuple[float, float]:
    """Middle of a run, from the start of the frame, and half of its length."""
    chirp = frame.chirp
    first_s, last_s = frame.chirps_s[[chirps.start, chirps.stop - 1]]
    end_s = last_s + chirp.adc_start_s + chirp.sampled_duration_s
    return (first_s + end_s) / 2, (end_s - first_s) / 2
