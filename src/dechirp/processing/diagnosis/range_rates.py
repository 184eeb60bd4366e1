"""Range rates and Doppler velocities of echoes in one frame: sign of the velocity, chirp phase.

The beat frequency of an echo moves by S 2 v / c, its Doppler frequency is 2 v / lambda. Both give
the velocity, the first coarsely but without a sign convention. Samples simulated with a phase
2 pi f(t) t instead of its integral have twice the slope, and twice the range rate.
"""

from dataclasses import dataclass

import numpy as np

from dechirp.processing.diagnosis.diagnosis import (
    NOTHING_FOUND,
    Diagnosis,
    cannot_be_told,
    mistake_found,
)
from dechirp.processing.diagnosis.map_peaks import MapPeaks
from dechirp.radar.frame import Frame
from dechirp.theory.windows import window_weights

_N_PEAKS = 12
_DECISIVE_CHI2 = 50.0
"""Misfit that rejects a hypothesis, and its lead over that accepted: 7 standard errors."""
_MAX_CHI2_PER_ECHO = 6.0
_ERROR_FACTOR = 1.6  # of a Hann window over the Cramer-Rao bound (1.53), rounded up
_RELATIVE_ERROR = 0.04  # of range rates: 2 % for 900 MHz at 24 GHz, doubled
_MIN_SLOW_CELLS = 3
_MAX_NEIGHBOUR = 1e-3  # of the power, within the half-frame cells of an echo


@dataclass(frozen=True)
class RangeRates:
    """Velocities of moving echoes of one frame, from Doppler frequency and range rate."""

    doppler_m_per_s: np.ndarray
    range_rate_m_per_s: np.ndarray
    std_m_per_s: np.ndarray
    """Standard error of the range rate."""


def measure_range_rates(samples: np.ndarray, peaks: MapPeaks, frame: Frame) -> RangeRates:
    """Measure the range rates of isolated moving echoes from the halves of a frame.

    `samples` are (chirp, channel, sample); peaks belong to a map of as many cells, with velocity 0
    in row n // 2.
    """
    n_chirps, _, n_samples = samples.shape
    half = n_chirps // 2
    slow = window_weights("hann", half)
    fast = window_weights("hann", n_samples)
    chirp = frame.chirp
    rows, velocities = [], frame.velocity_bins_m_per_s(n_chirps)
    for place in _isolated_moving_peaks(peaks, n_chirps)[:_N_PEAKS]:
        row, column = int(peaks.row[place]), int(peaks.column[place])
        turns = np.exp(-2j * np.pi * (row - n_chirps // 2) / n_chirps * np.arange(n_chirps))
        first, last = (
            _beat_cell_and_amplitude(
                np.tensordot(slow * turns[part], samples[part], axes=(0, 0)) * fast, column
            )
            for part in (slice(half), slice(n_chirps - half, n_chirps))
        )
        shift_m = (last[0] - first[0]) * chirp.range_resolution_m
        duration_s = (n_chirps - half) * frame.repetition_s
        # The phase between the halves refines the Doppler frequency of the row.
        turned = float(np.angle(np.vdot(first[1], last[1]))) / (2 * np.pi)
        velocity = velocities[row] + turned / duration_s * chirp.wavelength_m / 2
        # Bound of a half frame, whose integrated SNR is half, in units of a range cell.
        snr = peaks.snr[place] * np.log(2) * 1.5 * 1.5 / 2
        bound_m = chirp.range_resolution_m * np.sqrt(6 / snr) / (2 * np.pi)
        std = _ERROR_FACTOR * np.sqrt(2) * bound_m / duration_s
        rows.append((velocity, shift_m / duration_s, std))
    table = np.array(rows).reshape(-1, 3).T
    return RangeRates(doppler_m_per_s=table[0], range_rate_m_per_s=table[1], std_m_per_s=table[2])


def _isolated_moving_peaks(peaks: MapPeaks, n_chirps: int) -> list[int]:
    """Return moving peaks without a comparable neighbour, the strongest first."""
    moving = abs(peaks.row - n_chirps // 2) >= _MIN_SLOW_CELLS
    places = []
    for place in np.flatnonzero(moving):
        distance = abs(peaks.row - peaks.row[place])
        # Half a frame has a main lobe of 8 cells, and sidelobes below -50 dB 10 cells away.
        near = (np.minimum(distance, n_chirps - distance) < 10) & (
            abs(peaks.column - peaks.column[place]) < 6
        )
        near[place] = False
        if not np.any(near & (peaks.snr > _MAX_NEIGHBOUR * peaks.snr[place])):
            places.append(int(place))
    return places


def _beat_cell_and_amplitude(samples: np.ndarray, column: int) -> tuple[float, np.ndarray]:
    """Return the fractional cell of a tone near a column, and its amplitude in each channel.

    Samples (channel, sample) are Hann-windowed: beside the maximum, the amplitude ratio b gives
    (2 b - 1) / (b + 1) cells. Phases are those in the middle of the chirp, where a shift of the
    beat frequency does not turn them.
    """
    n_samples = samples.shape[1]
    cells = column + np.arange(-3, 4)
    centred = np.arange(n_samples) - (n_samples - 1) / 2
    spectrum = samples @ np.exp(-2j * np.pi * np.outer(centred, cells) / n_samples)
    amplitude = np.sqrt(np.sum(abs(spectrum) ** 2, axis=0))
    peak = 1 + int(np.argmax(amplitude[1:-1]))
    side = 1 if amplitude[peak + 1] > amplitude[peak - 1] else -1
    ratio = amplitude[peak + side] / amplitude[peak]
    cell = float(cells[peak] + side * (2 * ratio - 1) / (ratio + 1))
    # The Hann main lobe is positive, so the strongest cell has the phase of the tone.
    return cell, spectrum[:, peak]


def diagnose_range_rates(rates: RangeRates, frame: Frame) -> Diagnosis:
    """Compare range rates with Doppler velocities, with the opposite sign, and with twice them."""
    doppler, rate = rates.doppler_m_per_s, rates.range_rate_m_per_s
    # Settings are never exact, and the range migrates within the halves.
    std = np.hypot(rates.std_m_per_s, _RELATIVE_ERROR * rate)
    span = 2 * frame.max_velocity_m_per_s
    # True velocities may be aliased, so the nearest ambiguity counts.
    residual = rate - doppler
    residual -= span * np.round(residual / span)
    misfits = {
        "right": float(np.sum((residual / std) ** 2)),
        "sign": float(np.sum(((rate + doppler) / std) ** 2)),
        "phase": float(np.sum(((rate - 2 * doppler) / std) ** 2)),
    }
    alternative = "sign" if misfits["sign"] < misfits["phase"] else "phase"
    n_echoes = doppler.size
    is_clear = misfits["right"] - misfits[alternative] > _DECISIVE_CHI2
    if n_echoes and is_clear and misfits[alternative] < _MAX_CHI2_PER_ECHO * (n_echoes + 4):
        return _range_rate_mistake(rates, misfits, alternative)
    can_tell = bool(
        n_echoes
        and min(misfits["sign"], misfits["phase"]) - misfits["right"] > _DECISIVE_CHI2
        and misfits["right"] < _MAX_CHI2_PER_ECHO * (n_echoes + 4)
    )
    if can_tell:
        return NOTHING_FOUND
    reason = (
        f"range rates of {n_echoes} moving echoes, with standard errors of"
        f" {std.min():.3g} m/s or more"
        if n_echoes
        else "no isolated moving echo"
    )
    result = NOTHING_FOUND
    for setting in ("velocity_m_per_s.sign", "samples.phase"):
        result += cannot_be_told(
            setting,
            value=reason,
            expected="range rates that agree with one multiple of the Doppler velocities",
            fix="give a longer frame with a strong fast echo, or the range and velocity of a"
            " target",
        )
    return result


def _range_rate_mistake(
    rates: RangeRates, misfits: dict[str, float], alternative: str
) -> Diagnosis:
    weights = (rates.doppler_m_per_s / rates.std_m_per_s) ** 2
    ratio = float(
        np.sum(weights * rates.range_rate_m_per_s / rates.doppler_m_per_s) / weights.sum()
    )
    evidence = (
        f"range rates of {weights.size} echoes are {ratio:.3f} +- {weights.sum() ** -0.5:.3f}"
        f" times their Doppler velocities (misfit chi2 {misfits['right']:.0f} as claimed,"
        f" {misfits[alternative]:.0f} with this factor)"
    )
    if alternative == "sign":
        return mistake_found(
            "velocity_m_per_s.sign",
            value=evidence,
            expected="1: ranges of receding echoes grow, and their Doppler frequency is positive",
            fix="turn the phase of an echo by +4 pi R / lambda from chirp to chirp where its beat"
            " frequency is positive; or negate the velocity axis",
        )
    return mistake_found(
        "samples.phase",
        value=evidence,
        expected="1; 2 is the range rate of a chirp with the phase 2 pi f(t) t, whose slope is 2 S",
        fix="integrate the frequency: the phase of f0 + S t is 2 pi (f0 t + S t^2 / 2)",
    )
