"""Which fold a velocity is in, told from frames whose intervals differ."""

import math

import numba
import numpy as np
import xarray as xr

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.process.ambiguity import CERTAIN
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# Targets change their radial velocity from frame to frame by as much in a second, as standard
# deviation: braking and turning cars.
_ACCELERATION = 3.0  # m/s^2
# A target that is in one frame is found in another.
_IS_FOUND = 0.9
# Folds nearest to zero velocity that are compared: at 77 GHz and 35 us up to 1,700 m/s.
_MOST_FOLDS = 64


def unfolded(detections: xr.Dataset, radar: Radar) -> xr.Dataset:
    r"""Detections with the velocities that explain those of all frames, by a noisy remainder.

    A frame tells the velocity up to multiples of lambda / 2T, T its own. The hypothesis h of a
    detection, v + h lambda / 2T, and with it another range by range-Doppler coupling, says
    where the target is in the frames about it, as many as there are intervals, and at which
    remainder. For each such frame

    .. math::

        p \propto (1 - P) + P \sum_j \frac{N(\Delta v_j)\, N(\Delta R_j)}{\rho}

    over its detections j, rho their density: none need be this target. Variances are those of
    both standard errors, and of 3 m/s^2 in between. So a hypothesis gains from what lies where
    it says, the less the more crowded it is there, and loses little where a target fades.

    Parameters
    ----------
    detections : Dataset over `detection`
        As `detect` makes them, each frame with the interval it has in turn.
    radar : Radar
        Its intervals. Velocities are told within lambda / 2g, g the greatest common divisor of
        the repetitions, and among 64 folds at the most.

    Returns
    -------
    Dataset
        With `velocity`, `range`, `fold` and `fold_confidence` of the likeliest hypothesis; below
        a confidence of 0.99 the fold is NaN, and range and velocity are those about zero
        velocity. Angles told with a fold that turns transmitters otherwise are NaN.

    References
    ----------
    Of exact remainders: G. Trunk and S. Brockett, Range and velocity ambiguity resolution, IEEE
    National Radar Conference 1993. Of noisy ones: X.-G. Xia and G. Wang, Phase unwrapping and a
    robust Chinese remainder theorem, IEEE Signal Processing Letters 14(4), 2007.
    """
    radars = [radar.at(index) for index in range(radar.frame.n_intervals)]
    numbers = detections.frame.values.astype(np.int64)
    if not numbers.size or radar.frame.n_chirps == 1:
        return detections
    repetition_s = np.array([one.frame.repetition_s for one in radars])[numbers % len(radars)]
    chirp = radar.frame.chirp
    at = {name: detections[name].values for name in ("time", "range", "velocity")}
    wavelength_m = SPEED_OF_LIGHT / (
        chirp.mean_sampled_frequency_hz - at["range"] / chirp.range_m(1.0)
    )
    # From what a frame alone may have said, back to its remainder.
    known = np.nan_to_num(detections.fold.values)
    back_hz = -known / repetition_s
    doppler_hz = 2 * at["velocity"] / wavelength_m + back_hz
    fold = _hypotheses(doppler_hz, repetition_s, radar.frame)
    step_hz = (fold - known[:, None]) / repetition_s[:, None]
    range_m = at["range"][:, None] - chirp.range_m(1.0) * step_hz
    velocity = at["velocity"][:, None] + wavelength_m[:, None] / 2 * step_hz
    log_p = _log_prior(detections, fold, radars[0].frame.n_folds)
    extent_m = chirp.range_bins_m()[-1]
    measured = [
        *at.values(),
        *(detections[f"{name}_std"].values ** 2 for name in ("range", "velocity")),
    ]
    for number in np.unique(numbers):
        own = numbers == number
        for step in range(1 - len(radars), len(radars)):
            other = numbers == number + step
            if not step or not other.any():
                continue
            span = wavelength_m[other] / (2 * repetition_s[other])
            density = np.count_nonzero(other) / (extent_m * span.mean())
            log_p[own] += _log_evidence(
                range_m[own],
                velocity[own],
                np.array([of[own] for of in measured]),
                np.array([of[other] for of in measured]),
                span,
                chirp.range_m(1.0) / repetition_s[other],
                density,
            )
    log_p -= log_p.max(axis=1, keepdims=True)
    p = np.exp(log_p)
    p /= p.sum(axis=1, keepdims=True)
    best, rows = p.argmax(axis=1), np.arange(len(p))
    confidence = p[rows, best]
    certain = confidence >= CERTAIN
    told = {
        "range": np.where(certain, range_m[rows, best], at["range"] - chirp.range_m(1.0) * back_hz),
        "velocity": np.where(certain, velocity[rows, best], doppler_hz * wavelength_m / 2),
        "fold": np.where(certain, fold[rows, best], np.nan),
        "fold_confidence": confidence,
    }
    # Slots turn against each other by the fold: a direction told with another one is none.
    moved = np.nan_to_num(told["fold"]) - known
    same = moved % radar.frame.n_slots == 0
    told |= {
        f"{name}{of}": np.where(same, detections[f"{name}{of}"].values, np.nan)
        for name in ("azimuth", "elevation")
        for of in ("", "_std")
    }
    return detections.assign({name: detections[name].copy(data=of) for name, of in told.items()})


def _hypotheses(doppler_hz: np.ndarray, repetition_s: np.ndarray, frame: Frame) -> np.ndarray:
    """Folds nearest to zero velocity that all intervals together tell, (n, most); else NaN.

    As many as the greatest common divisor goes into the repetition of the frame.
    """
    steps = [round(frame.at(index).repetition_s * 1e12) for index in range(frame.n_intervals)]
    n_folds = np.round(repetition_s * 1e12 / math.gcd(*steps)).astype(np.int64)
    n_folds = np.minimum(n_folds, _MOST_FOLDS)[:, None]
    places = np.arange(n_folds.max())
    first = np.ceil(-n_folds / 2 - (doppler_hz * repetition_s)[:, None])
    return np.where(places < n_folds, first + places, np.nan)


def _log_prior(detections: xr.Dataset, fold: np.ndarray, n_folds: int) -> np.ndarray:
    """What a frame has told of each hypothesis: slots tell folds up to multiples of n_folds."""
    told = detections.fold.values[:, None]
    sure = np.clip(detections.fold_confidence.values[:, None], 1e-6, 1 - 1e-6)
    beside = (fold - told) % n_folds != 0
    log_p = np.where(beside, np.log((1 - sure) / max(n_folds - 1, 1)), np.log(sure))
    log_p = np.where(np.isnan(told) | (n_folds == 1), 0.0, log_p)
    return np.where(np.isnan(fold), -np.inf, log_p)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _log_evidence(
    range_m: np.ndarray,
    velocity: np.ndarray,
    own: np.ndarray,
    other: np.ndarray,
    span: np.ndarray,
    coupling_m: np.ndarray,
    density: float,
) -> np.ndarray:
    """What the detections of another frame say of each hypothesis, (n, n_folds).

    `own` and `other`, (5, n): times, ranges, velocities, and the variances of those two. `span`
    and `coupling_m`: by what a fold of the others moves their velocity, and takes off their range.
    """
    out = np.empty(range_m.shape)
    for i in range(range_m.shape[0]):
        for h in range(range_m.shape[1]):
            likelihood = 0.0
            for j in range(other.shape[1]):
                late_s = other[0, j] - own[0, i]
                changed = (_ACCELERATION * late_s) ** 2
                var_v = own[4, i] + other[4, j] + changed
                var_r = own[3, i] + other[3, j] + changed * late_s**2 / 4 + own[4, i] * late_s**2
                dv = other[2, j] - velocity[i, h]
                folds = np.round(dv / span[j])  # by which the other one is out
                dv -= folds * span[j]
                z = dv * dv / var_v
                if not z < 50.0:  # nor where there is no hypothesis
                    continue
                dr = other[1, j] + folds * coupling_m[j] - range_m[i, h] - velocity[i, h] * late_s
                z += dr * dr / var_r
                likelihood += np.exp(-z / 2) / (2 * np.pi * np.sqrt(var_v * var_r))
            out[i, h] = np.log(1 - _IS_FOUND + _IS_FOUND * likelihood / density)
    return out
