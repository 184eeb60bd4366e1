"""Which fold a velocity is in, told from how the slots of a round turn against each other.

A round samples the Doppler frequency once, so velocities repeat every lambda / 2T, T its
duration. Within a round, though, a fold of h turns on by h / n_slots of a cycle from slot to
slot: each hypothesis makes other amplitudes of the same channels, and only those of the true
one are what a wave from some direction gives (all transmitters), or leave empty sub-bands empty
(codes with more slots than transmitters).
"""

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from scipy.special import gammaincinv

from dechirp.process.angle.aperture import Aperture
from dechirp.process.virtual import turns
from dechirp.radar.calibration import Calibration
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# A fold that is less certain is not told.
CERTAIN = 0.99

# By so much, relative to the echo, amplitudes may differ from what the array is known to answer:
# 1.7 degrees of phase, or 0.26 dB. What fits better than that is no evidence.
_UNKNOWN = 0.03
# Of the power, what a beam may gain between the points of a grid of two axes, beyond what
# parabolas along each tell. Four elements on a plane fit any fold to 1 %: no evidence either.
_BETWEEN = 0.005

# Beams of so many detections at once: 16 MiB of them.
_BEAMS = 2**21


class Responses(NamedTuple):
    """What the channels hold of a target at rest, for each direction that is searched."""

    unit: np.ndarray
    """(n_directions, n_slots * n_rx) complex64, each of length 1; azimuth runs fastest."""
    n_azimuths: int


class Folds(NamedTuple):
    """Folds of n detections."""

    probability: np.ndarray
    """(n, n_folds): of each hypothesis, all of them as likely beforehand."""
    fold: np.ndarray
    """(n, n_folds): what each says, whole numbers: Doppler is principal + fold / repetition."""

    @property
    def certain(self) -> np.ndarray:
        """Fold of the likeliest hypothesis, NaN where it is not certain, (n,)."""
        best = self.probability.argmax(axis=1)[:, None]
        fold = np.take_along_axis(self.fold, best, axis=1)[:, 0]
        return np.where(self.confidence >= CERTAIN, fold, np.nan)

    @property
    def confidence(self) -> np.ndarray:
        """Probability of the likeliest hypothesis, (n,)."""
        return np.asarray(self.probability.max(axis=1))


def responses(radar: Radar, seen: Aperture) -> Responses:
    """Responses of the channels of a radar, towards the directions of the grid.

    What the elements answer is the steering over the gains that undo their channels.
    """
    return _responses(radar.frame.weights, radar.calibration, radar.array.n_rx, seen)


@lru_cache(maxsize=4)
def _responses(
    weights: tuple[tuple[complex, ...], ...],
    calibration: Calibration | None,
    n_rx: int,
    seen: Aperture,
) -> Responses:
    code = np.array(weights)
    elements = seen.grid.steering
    if calibration is not None:
        elements = elements / calibration.factors()
    by_tx = elements.reshape(len(elements), code.shape[1], n_rx)
    channels = np.einsum("lt,gtr->glr", code, by_tx).reshape(len(elements), -1)
    lengths = np.linalg.norm(channels, axis=1, keepdims=True)
    unit = channels / np.maximum(lengths, np.finfo(np.float32).tiny)
    return Responses(unit.astype(np.complex64), len(seen.grid.azimuth_rad))


def unknown(n: int) -> Folds:
    """Of n detections about whose folds nothing is known."""
    return Folds(*np.full((2, n, 1), np.nan))


def hypotheses(frame: Frame, doppler_hz: np.ndarray) -> np.ndarray:
    """Folds that a round tells apart, (n, n_folds): nearest to zero velocity.

    Slots at even steps of the interval tell as many as there are, those whose Doppler
    frequencies lie within half a cycle an interval: the span of one transmitter alone.
    """
    principal = doppler_hz[:, None] * frame.repetition_s
    any_of = principal + np.arange(frame.n_folds)
    nearest = any_of - frame.n_folds * np.round(any_of / frame.n_folds)
    return np.asarray(np.round(nearest - principal))


def folds(
    amplitudes: np.ndarray,
    frame: Frame,
    doppler_hz: np.ndarray,
    answers: Responses,
    noise_power: np.ndarray,
) -> Folds:
    r"""Probability of each fold, from the amplitudes of the channels.

    .. math::

        p(h) \propto \int \exp \frac{|\mathbf{b}^H(u)\, D_h^*\, \mathbf{x}|^2}{\sigma^2}
        \,\mathrm{d}u

    with x the amplitudes, D_h the turns between slots at fold h and b the response of unit
    length: the amplitude of the target is integrated out, the directions u are summed over the
    grid, as likely as each other. The sum is raised by what the highest beam gains between
    points of the grid, from a parabola: up to 1.3 at 20 dB, eight points to the beam's null.

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx), complex
        See `process.virtual.channels`.
    frame : Frame
        Its code and times.
    doppler_hz : array (n,)
        Principal values, within half a cycle a repetition of zero.
    answers : Responses
        Of the channels.
    noise_power : array (n,)
        E|w|^2 in one amplitude.

    Notes
    -----
    The model is one source in white noise. Where more is left beside the best beam than noise
    leaves once in 1,000 times (two sources in the cell, an array that is not calibrated), a fold
    must fit better by much more than what is left: confidence falls. Of two equal sources before
    eight elements or more, 85 to 95 % have no certain fold and 1 % a wrong one at 20 dB, none at
    35 dB. Before four elements one source at a wrong fold fits two too well: 6 % are wrong.

    References
    ----------
    The hypotheses are those of C. M. Schmid, R. Feger, C. Pfeffer and A. Stelzer, Motion
    compensation and efficient array design for TDMA FMCW MIMO radar systems, EuCAP 2012; for
    empty sub-bands F. Jansen, Automotive radar Doppler division MIMO, EuRAD 2019.
    """
    n, n_channels = amplitudes.shape
    fold = hypotheses(frame, doppler_hz)
    turned = turns(frame, (doppler_hz[:, None] + fold / frame.repetition_s)).conj()
    n_rx = n_channels // frame.n_slots
    by_slot = amplitudes.reshape(n, 1, frame.n_slots, n_rx) * turned[..., None]
    still = by_slot.reshape(*fold.shape, n_channels).astype(np.complex64)
    total = np.sum(np.abs(amplitudes) ** 2, axis=1)
    most = _most_left(n_channels)
    unknown = _UNKNOWN**2 / n_channels
    is_plane = 1 < answers.n_azimuths < len(answers.unit)
    no_evidence = max(unknown, _BETWEEN) if is_plane else unknown
    log_evidence = np.empty(fold.shape)
    block = max(1, _BEAMS // (frame.n_folds * len(answers.unit)))
    for start in range(0, n, block):
        own = slice(start, start + block)
        beams = still[own] @ answers.unit.conj().T
        log_evidence[own] = _log_evidence(
            beams, answers.n_azimuths, total[own], noise_power[own], most, unknown, no_evidence
        )
    weight = np.exp(log_evidence - log_evidence.max(axis=1, keepdims=True))
    return Folds(weight / weight.sum(axis=1, keepdims=True), fold)


@lru_cache
def _most_left(n_channels: int) -> float:
    """Noise powers that are left beside the best beam once in 1,000 times."""
    # An amplitude, and two angles at the most, are fitted.
    return float(gammaincinv(max(n_channels - 2.0, 1.0), 0.999))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _log_evidence(
    beams: np.ndarray,
    n_azimuths: int,
    total: np.ndarray,
    noise_power: np.ndarray,
    most: float,
    unknown: float,
    no_evidence: float,
) -> np.ndarray:
    """Logarithm of the integral over directions, (n, n_folds), of beams (n, n_folds, direction)."""
    n, n_folds, n_directions = beams.shape
    out = np.empty((n, n_folds))
    power = np.empty((n_folds, n_directions))
    top = np.empty(n_folds)
    between = np.empty(n_folds)
    for i in range(n):
        for h in range(n_folds):
            at = 0
            for g in range(n_directions):
                z = beams[i, h, g]
                power[h, g] = z.real * z.real + z.imag * z.imag
                if power[h, g] > power[h, at]:
                    at = g
            top[h] = power[h, at]
            column, row = at % n_azimuths, at // n_azimuths
            between[h] = _gained(power[h, row * n_azimuths : (row + 1) * n_azimuths], column)
            between[h] += _gained(power[h, column::n_azimuths], row)
            between[h] = min(between[h], total[i] - top[h])  # all there is
        unfitted = total[i] - np.max(top + between)
        noise = noise_power[i] + no_evidence * total[i]
        if unfitted > most * (noise_power[i] + unknown * total[i]):
            noise = max(noise, unfitted)
        for h in range(n_folds):
            weight = 0.0
            for g in range(n_directions):
                down = (power[h, g] - top[h]) / noise
                if down > -30.0:
                    weight += np.exp(down)
            out[i, h] = (top[h] + between[h]) / noise + np.log(weight)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gained(power: np.ndarray, top: int) -> float:
    """How much higher than at the top point a parabola through it and its neighbours is.

    A top at the end may have its hill up to half a step beyond.
    """
    if power.size < 3:
        return 0.0
    middle = min(max(top, 1), power.size - 2)
    slope = (power[middle + 1] - power[middle - 1]) / 2
    curve = 2 * power[middle] - power[middle - 1] - power[middle + 1]
    if curve <= 0:
        return 0.0
    off = min(max(slope / curve, -1.5), 1.5)
    return max(power[middle] + off * (slope - off * curve / 2) - power[top], 0.0)
