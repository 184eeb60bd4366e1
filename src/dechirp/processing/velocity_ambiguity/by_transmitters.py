"""Velocity ambiguity resolved by the phases between the transmitters of a round.

A round samples the Doppler frequency once, so velocities repeat every lambda / 2T, T its
duration. Within a round, however, an ambiguity number h adds a phase of h / n_slots cycles from
slot to slot: each hypothesis compensates the channels differently, and only with the true one are
they the response to a wave from some direction (all transmitters), or are empty sub-bands empty
(codes with more slots than transmitters).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.velocity_ambiguity.hypotheses import (
    AmbiguityHypotheses,
    resolvable_ambiguity_numbers,
)
from dechirp.processing.virtual_array import slot_phase_factors
from dechirp.radar.calibration import Calibration
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# Error of the modelled channel responses relative to the echo: 1.7 degrees of phase, or 0.26 dB.
# Differences in fit below that are no evidence.
_MODEL_ERROR = 0.03
# Share of the power that a beam may gain between the points of a grid of two axes, beyond parabolas
# along each. Four elements on a plane fit any ambiguity number to 1 %, which is no evidence either.
_GRID_LOSS = 0.005

# Beams computed at once: 16 MiB.
_BEAMS_PER_BLOCK = 2**21


class ChannelResponses(NamedTuple):
    """Responses of the channels to a static target, for each direction searched."""

    unit: np.ndarray
    """(n_directions, n_slots * n_rx) complex64, each of norm 1; azimuth varies fastest."""
    n_azimuths: int


def channel_responses(radar: Radar, aperture: Aperture) -> ChannelResponses:
    """Return the responses of the channels of a radar to the directions of the grid.

    The response of an element is its steering over its calibration factor.
    """
    return _cached_channel_responses(
        radar.frame.weights, radar.calibration, radar.array.n_rx, aperture
    )


@lru_cache(maxsize=4)
def _cached_channel_responses(
    weights: tuple[tuple[complex, ...], ...],
    calibration: Calibration | None,
    n_rx: int,
    aperture: Aperture,
) -> ChannelResponses:
    code = np.array(weights)
    elements = aperture.direction_grid.steering
    if calibration is not None:
        elements = elements / calibration.element_corrections()
    by_tx = elements.reshape(len(elements), code.shape[1], n_rx)
    channels = np.einsum("lt,gtr->glr", code, by_tx).reshape(len(elements), -1)
    lengths = np.linalg.norm(channels, axis=1, keepdims=True)
    unit = channels / np.maximum(lengths, np.finfo(np.float32).tiny)
    return ChannelResponses(unit.astype(np.complex64), len(aperture.direction_grid.azimuth_rad))


def ambiguity_probabilities(
    amplitudes: np.ndarray,
    frame: Frame,
    doppler_hz: np.ndarray,
    responses: ChannelResponses,
    noise_power: np.ndarray,
) -> AmbiguityHypotheses:
    r"""Compute the probability of each ambiguity number from the amplitudes of the channels.

    .. math::

        p(h) \propto \int \exp \frac{|\mathbf{b}^H(u)\, D_h^*\, \mathbf{x}|^2}{\sigma^2}
        \,\mathrm{d}u

    with x the amplitudes, D_h the phase factors between slots for ambiguity number h and b the
    response of unit norm: the amplitude of the target is integrated out, the equally likely
    directions u are summed over the grid. The sum is increased by the gain of the highest beam
    between points of the grid, from a parabola: up to 1.3 at 20 dB, eight points to the beam's
    null.

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx), complex
        See `processing.virtual_array.split_chirps_into_slots`.
    frame : Frame
        Its code and times.
    doppler_hz : array (n,)
        Principal values, within half a cycle a repetition of zero.
    responses : ChannelResponses
        Of the channels.
    noise_power : array (n,)
        E|w|^2 in one amplitude.

    Notes
    -----
    The model is one source in white noise. If the residual of the best beam exceeds that of noise
    at a probability of 0.001 (two sources in the cell, an uncalibrated array), the residual counts
    as noise, and confidence falls. With two equal sources and eight elements or more, 85 to 95 %
    of detections have no certain number and 1 % a wrong one at 20 dB, none at 35 dB. With four
    elements one source at a wrong number fits two sources too well: 6 % are wrong.

    References
    ----------
    The hypotheses are those of C. M. Schmid, R. Feger, C. Pfeffer and A. Stelzer, Motion
    compensation and efficient array design for TDMA FMCW MIMO radar systems, EuCAP 2012; for
    empty sub-bands F. Jansen, Automotive radar Doppler division MIMO, EuRAD 2019.
    """
    n, n_channels = amplitudes.shape
    numbers = resolvable_ambiguity_numbers(frame, doppler_hz)
    compensation = slot_phase_factors(
        frame, (doppler_hz[:, None] + numbers / frame.repetition_s)
    ).conj()
    n_rx = n_channels // frame.n_slots
    by_slot = amplitudes.reshape(n, 1, frame.n_slots, n_rx) * compensation[..., None]
    compensated = by_slot.reshape(*numbers.shape, n_channels).astype(np.complex64)
    total = np.sum(np.abs(amplitudes) ** 2, axis=1)
    max_residual = _upper_noise_residual_quantile(n_channels)
    model_error = _MODEL_ERROR**2 / n_channels
    is_plane = 1 < responses.n_azimuths < len(responses.unit)
    grid_error = max(model_error, _GRID_LOSS) if is_plane else model_error
    log_evidence = np.empty(numbers.shape)
    block = max(1, _BEAMS_PER_BLOCK // (frame.n_resolvable_ambiguities * len(responses.unit)))
    for start in range(0, n, block):
        rows = slice(start, start + block)
        beams = compensated[rows] @ responses.unit.conj().T
        log_evidence[rows] = _log_evidence_over_directions(
            beams,
            responses.n_azimuths,
            total[rows],
            noise_power[rows],
            max_residual,
            model_error,
            grid_error,
        )
    weight = np.exp(log_evidence - log_evidence.max(axis=1, keepdims=True))
    return AmbiguityHypotheses(weight / weight.sum(axis=1, keepdims=True), numbers)


@lru_cache
def _upper_noise_residual_quantile(n_channels: int) -> float:
    """Return the residual of the best beam that noise exceeds with probability 0.001."""
    # One amplitude and at most two angles are fitted.
    return float(scipy.special.gammaincinv(max(n_channels - 2.0, 1.0), 0.999))


def _log_evidence_in_numpy(
    beams: np.ndarray,
    n_azimuths: int,
    total: np.ndarray,
    noise_power: np.ndarray,
    max_residual: float,
    model_error: float,
    grid_error: float,
) -> np.ndarray:
    """Plain twin of `_log_evidence_over_directions`: equal within rounding."""
    out = np.empty(beams.shape[:2])
    for i, spectra in enumerate(beams):
        power = (spectra.real * spectra.real + spectra.imag * spectra.imag).astype(float)
        best = power.argmax(axis=1)
        top = power[np.arange(len(power)), best]
        gain = np.array(
            [
                _parabola_vertex_gain(maps[row], column)
                + _parabola_vertex_gain(maps[:, column], row)
                for maps, row, column in zip(
                    power.reshape(len(power), -1, n_azimuths),
                    best // n_azimuths,
                    best % n_azimuths,
                    strict=True,
                )
            ]
        )
        gain = np.minimum(gain, total[i] - top)  # at most the total power
        unfitted = total[i] - np.max(top + gain)
        noise = noise_power[i] + grid_error * total[i]
        if unfitted > max_residual * (noise_power[i] + model_error * total[i]):
            noise = max(noise, unfitted)
        down = (power - top[:, None]) / noise
        weight = np.sum(np.where(down > -30.0, np.exp(down), 0.0), axis=1)
        out[i] = (top + gain) / noise + np.log(weight)
    return out


@kernel(plain=_log_evidence_in_numpy)
def _log_evidence_over_directions(
    beams: np.ndarray,
    n_azimuths: int,
    total: np.ndarray,
    noise_power: np.ndarray,
    max_residual: float,
    model_error: float,
    grid_error: float,
) -> np.ndarray:
    """Integrate over directions: logarithms, (n, n_folds), from beams (n, n_folds, direction)."""
    n, n_folds, n_directions = beams.shape
    out = np.empty((n, n_folds))
    power = np.empty((n_folds, n_directions))
    top = np.empty(n_folds)
    grid_gain = np.empty(n_folds)
    for i in range(n):
        for h in range(n_folds):
            best_direction = 0
            for g in range(n_directions):
                z = beams[i, h, g]
                power[h, g] = z.real * z.real + z.imag * z.imag
                if power[h, g] > power[h, best_direction]:
                    best_direction = g
            top[h] = power[h, best_direction]
            column, row = best_direction % n_azimuths, best_direction // n_azimuths
            grid_gain[h] = _parabola_vertex_gain(
                power[h, row * n_azimuths : (row + 1) * n_azimuths], column
            )
            grid_gain[h] += _parabola_vertex_gain(power[h, column::n_azimuths], row)
            grid_gain[h] = min(grid_gain[h], total[i] - top[h])  # at most the total power
        unfitted = total[i] - np.max(top + grid_gain)
        noise = noise_power[i] + grid_error * total[i]
        if unfitted > max_residual * (noise_power[i] + model_error * total[i]):
            noise = max(noise, unfitted)
        for h in range(n_folds):
            weight = 0.0
            for g in range(n_directions):
                down = (power[h, g] - top[h]) / noise
                if down > -30.0:
                    weight += np.exp(down)
            out[i, h] = (top[h] + grid_gain[h]) / noise + np.log(weight)
    return out


@kernel(plain=AS_WRITTEN)
def _parabola_vertex_gain(power: np.ndarray, top: int) -> float:
    """Return the gain of the parabola through a maximum and its neighbours over the maximum.

    At the end of the grid the vertex may lie up to half a step beyond it.
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
