"""Steps and origins of the range and velocity axes of a map, compared with the radar."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from dechirp.core.text import format_number
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.diagnosis.diagnosis import (
    NOTHING_FOUND,
    Diagnosis,
    cannot_be_told,
    mistake_found,
)
from dechirp.processing.diagnosis.map_peaks import measure_main_lobes, noise_correlation
from dechirp.processing.diagnosis.window_leakage import measure_leakage
from dechirp.radar.frame import Frame
from dechirp.theory.windows import Window, bin_correlation, window_weights

_MAX_END_ERROR_CELLS = 0.25
"""Accepted error at the end of an axis; `linspace` with both ends makes one of a cell."""
_MIN_SIGNIFICANCE = 5.0
_LAGS = np.arange(1, 5)
_MIN_LOBES, _LOBE_MARGIN = 3, 0.1


@dataclass(frozen=True)
class AxisScale:
    """Length of the transform behind an axis, and mistakes of the axis."""

    n_bins: float
    """Number of bins of the transform; NaN if unknown."""
    diagnosis: Diagnosis


@dataclass(frozen=True)
class _Axis:
    """One axis of a map, and the transform lengths that it may have."""

    name: str
    unit: str
    values: np.ndarray
    number: int
    """Number of the axis in the map."""
    span: float
    """Step of the axis times the number of bins of the transform."""
    n_points: int
    """Number of points before the transform."""
    min_bins: int
    """Fewest bins that make so many cells."""
    usual_bins: Sequence[int]
    """Numbers of bins that usually make so many cells, the most usual one first."""
    tolerance: float
    """Relative tolerance of the step."""
    ramp_ratio: float = 1.0
    """Ratio of the steps of a known mistake to the right ones, which no usual FFT has."""

    @property
    def implied_bins(self) -> float:
        """Number of bins that the step of the axis implies."""
        step = abs(float(self.values[-1] - self.values[0])) / (self.values.size - 1)
        return self.span / step

    def implies(self, n_bins: float) -> bool:
        """Return whether the step implies this number of bins, with c of 3e8 m/s too."""
        return any(
            abs(self.implied_bins * rounding / n_bins - 1) < self.tolerance
            for rounding in (1.0, 3e8 / SPEED_OF_LIGHT)
        )


def diagnose_range_axis(
    range_m: np.ndarray, power: np.ndarray, frame: Frame, *, is_mirrored: bool
) -> AxisScale:
    """Compare the range axis with k c fs / 2 S n, n the number of bins of the FFT."""
    chirp, n_cells = frame.chirp, range_m.size
    is_half = chirp.sampling == "real" and not is_mirrored
    lengths = [2 * n_cells - 2, 2 * n_cells, 2 * n_cells - 1] if is_half else [n_cells]
    usual = [n for n in lengths if n >= chirp.n_samples] or [chirp.n_samples]
    axis = _Axis(
        name="range_m",
        unit="m",
        values=range_m,
        number=1,
        span=chirp.range_m(chirp.sample_rate_hz),
        n_points=chirp.n_samples,
        min_bins=max(chirp.n_samples, 2 * n_cells - 2 if is_half else n_cells),
        usual_bins=usual,
        tolerance=_MAX_END_ERROR_CELLS / n_cells,
        ramp_ratio=chirp.sampled_bandwidth_hz / chirp.ramp_bandwidth_hz,
    )
    causes = {
        2.0: "the axis of a half spectrum ends at fs instead of fs / 2, or the delay 2 R / c is"
        " taken as R / c",
        0.5: "the axis of a spectrum up to fs ends at fs / 2, or the factor 1/2 is applied twice",
        axis.ramp_ratio: "the bandwidth B in c / 2 B is that"
        " swept while sampling, S N / fs, not that of the whole ramp",
        n_cells / (n_cells - 1): "linspace with both ends has one step too few: use arange(n)"
        " times the step",
        axis.usual_bins[0] / chirp.n_samples: "the FFT is zero-padded: its steps are c fs / 2 S n"
        " with n its number of bins, not the number of samples",
    }
    scale = _diagnose_step(axis, power, causes)
    if scale.diagnosis.findings or not np.isfinite(scale.n_bins):
        return scale
    return _diagnose_range_origin(range_m, scale.n_bins, axis.span, is_half=is_half)


def _diagnose_range_origin(
    range_m: np.ndarray, n_bins: float, span_m: float, *, is_half: bool
) -> AxisScale:
    """Check that an axis of all cells starts at 0, or at minus half the span after fftshift."""
    n_kept = n_bins // 2 + 1 if is_half else n_bins
    first = float(range_m.min()) * n_bins / span_m
    allowed = (0.0,) if is_half else (0.0, -(n_bins // 2))
    is_cropped = range_m.size < n_kept  # an axis without its first cells may start anywhere
    if is_cropped or min(abs(first - cell) for cell in allowed) < _MAX_END_ERROR_CELLS:
        return AxisScale(n_bins=n_bins, diagnosis=NOTHING_FOUND)
    return AxisScale(
        n_bins=n_bins,
        diagnosis=mistake_found(
            "range_m.offset",
            value=f"{format_number(float(range_m.min()))} m in the first of all {range_m.size}"
            f" cells, {first:.3g} steps from 0 (tolerance {_MAX_END_ERROR_CELLS})",
            expected="0 m in the cell of the beat frequency 0",
            fix="count cells from 0: range = k c fs / (2 S n), also where indices start at 1",
        ),
    )


def diagnose_velocity_axis(
    velocity_m_per_s: np.ndarray, power: np.ndarray, frame: Frame
) -> AxisScale:
    """Compare the velocity axis with steps of lambda / 2 n T, T the repetition interval."""
    chirp, n_cells = frame.chirp, velocity_m_per_s.size
    interval_s = frame.single_interval_s
    bandwidth = chirp.ramp_bandwidth_hz / chirp.start_frequency_hz
    axis = _Axis(
        name="velocity_m_per_s",
        unit="m/s",
        values=velocity_m_per_s,
        number=0,
        span=chirp.wavelength_m / (2 * frame.repetition_s),
        n_points=frame.n_chirps,
        min_bins=max(n_cells, frame.n_chirps),
        usual_bins=[max(n_cells, frame.n_chirps)],
        # The wavelength may be that of the start, the middle or the end of the ramp.
        tolerance=_MAX_END_ERROR_CELLS / n_cells + bandwidth,
    )
    causes = {
        2.0: "the velocity is lambda f / 2, not lambda f, because the path is two-way",
        0.5: "the factor 1/2 is applied twice, or the interval is that of two chirps",
        3.6: "velocities are in m/s, not in km/h",
        float(frame.n_slots): "transmitters take turns: the interval is from a chirp of one"
        " transmitter to its next, not to the next chirp",
        interval_s / chirp.ramp_duration_s: "the interval is from the start of a chirp to the"
        " start of the next, with the idle time, not the duration of the ramp",
        interval_s / chirp.sampled_duration_s: "the interval is from the start of a chirp to the"
        " start of the next, with the idle time, not the sampled part",
        n_cells / (n_cells - 1): "linspace with both ends has one step too few: use"
        " fftshift(fftfreq(n, T)) times lambda / 2",
        axis.usual_bins[0] / frame.n_chirps: "the FFT is zero-padded: its steps are lambda / 2 n T"
        " with n its number of bins, not the number of chirps",
    }
    scale = _diagnose_step(axis, power, causes)
    if scale.diagnosis.findings:
        return scale
    step = abs(velocity_m_per_s[-1] - velocity_m_per_s[0]) / (n_cells - 1)
    nearest = float(abs(velocity_m_per_s).min() / step)
    if nearest < _MAX_END_ERROR_CELLS:
        return scale
    return AxisScale(
        n_bins=scale.n_bins,
        diagnosis=mistake_found(
            "velocity_m_per_s.scale",
            value=f"no cell at velocity 0: the nearest is {nearest:.2f} cells beside it (tolerance"
            f" {_MAX_END_ERROR_CELLS})",
            expected="0 in one cell, which is the Doppler frequency 0",
            fix="linspace from -v to v with both ends misses it: use fftshift(fftfreq(n, T)) times"
            " lambda / 2",
        ),
    )


def _diagnose_step(axis: _Axis, power: np.ndarray, causes: Mapping[float, str]) -> AxisScale:
    """Compare the step of an axis with the steps that its number of cells allows."""
    for n_bins in (*axis.usual_bins, axis.n_points):
        if n_bins >= axis.min_bins and axis.implies(n_bins):
            return AxisScale(n_bins=n_bins, diagnosis=NOTHING_FOUND)
    usual = axis.usual_bins[0]
    evidence = f"an FFT of fewer than {axis.min_bins} bins does not have {axis.values.size} cells"
    if axis.implied_bins > axis.min_bins:
        # The step fits a longer FFT of which cells were left out: its noise would be correlated.
        implied = round(axis.implied_bins)
        significance = _significance_of_length(power, axis, usual, implied)
        lobes = (
            ""
            if abs(significance) > _MIN_SIGNIFICANCE
            else _lobes_of_length(power, axis, usual, implied)
        )
        if significance < -_MIN_SIGNIFICANCE:
            return AxisScale(n_bins=implied, diagnosis=NOTHING_FOUND)
        is_ramp = abs(usual / axis.implied_bins / axis.ramp_ratio - 1) < axis.tolerance
        is_length = axis.implies(implied) and _is_product_of_small_primes(implied)
        # Ranges that were left out of a padded FFT have such ratios by chance.
        is_plausible = is_length and not (is_ramp and usual % axis.n_points == 0)
        if is_plausible and significance < _MIN_SIGNIFICANCE and not lobes:
            return AxisScale(
                n_bins=np.nan,
                diagnosis=cannot_be_told(
                    f"{axis.name}.scale",
                    value=f"{axis.values.size} cells of an FFT of {usual} or of {implied} bins,"
                    f" {significance:.1f} sigma apart in the correlation of the noise",
                    expected=f"at least {_MIN_SIGNIFICANCE:.0f} sigma",
                    fix="give all cells of the FFT",
                ),
            )
        evidence = lobes or (
            f"the correlation of the noise between cells fits it better than"
            f" {axis.implied_bins:.5g} bins, by {significance:.1f} sigma"
        )
    ratio = usual / axis.implied_bins
    nearest = min(causes, key=lambda factor: abs(np.log(ratio / factor)) if factor != 1 else 9.0)
    is_known = abs(ratio / nearest - 1) < 2 * axis.tolerance
    step = axis.span / usual
    return AxisScale(
        n_bins=usual,
        diagnosis=mistake_found(
            f"{axis.name}.scale",
            value=f"steps of {format_number(step * ratio, 5)} {axis.unit}, {ratio:.5g} times those"
            f" of an FFT of {usual} bins ({evidence})",
            expected=f"steps of {format_number(step, 5)} {axis.unit}, within {axis.tolerance:.2%}",
            fix=causes[nearest]
            if is_known
            else "check the settings of the radar, and the number of bins of the FFT",
        ),
    )


def _significance_of_length(power: np.ndarray, axis: _Axis, usual: int, implied: int) -> float:
    """Return by how many standard errors the noise fits `usual` bins better than `implied` ones.

    The powers of noise in two cells have the squared correlation of their amplitudes, which
    depends on window and zero padding. The window is that which fits best; a rectangular one
    leaves leakage.
    """
    if power.shape[axis.number] < 4 * _LAGS[-1] or axis.n_points < 4:
        return 0.0
    measured = noise_correlation(power, axis.number, _LAGS)
    std = 1.5 / np.sqrt(power.size)  # correlated cells have errors of up to 1.5 times those
    misfits = []
    for n_bins in (usual, implied):
        leakage = measure_leakage(power, axis.number, n_bins / axis.n_points)
        models = [
            abs(bin_correlation(window_weights(window, axis.n_points), n_bins, _LAGS)) ** 2
            for window in get_args(Window)
            if window != "rectangular" or leakage.has_rectangular_sidelobes or not leakage.n_cells
        ]
        misfits.append(min(float(np.linalg.norm(measured - model)) for model in models))
    return (misfits[1] - misfits[0]) / std


def _lobes_of_length(power: np.ndarray, axis: _Axis, usual: int, implied: int) -> str:
    """Return the evidence of strong echoes for `usual` bins against `implied` ones; else empty.

    Of windows of n points, more bins make the main lobe wider in cells.
    """
    lobes = measure_main_lobes(power, axis.number)
    if lobes.size < _MIN_LOBES or axis.n_points < 8:
        return ""
    lobe = float(np.median(lobes))
    limits = []
    for n_bins in (usual, implied):
        leakage = measure_leakage(power, axis.number, n_bins / axis.n_points)
        shapes = [
            _main_lobes_of_window(window_weights(window, axis.n_points), n_bins)
            for window in get_args(Window)
            if window != "rectangular" or leakage.has_rectangular_sidelobes or not leakage.n_cells
        ]
        limits.append((min(map(np.min, shapes)), max(map(np.max, shapes))))
    (low, high), (longer_low, _) = limits
    if low - _LOBE_MARGIN < lobe < min(high, longer_low - _LOBE_MARGIN):
        return (
            f"the neighbours of {lobes.size} echoes have {lobe:.2f} times the amplitude of their"
            f" peaks together, those of {implied} bins {longer_low:.2f} or more"
        )
    return ""


def _main_lobes_of_window(weights: np.ndarray, n_bins: int) -> np.ndarray:
    """Return the amplitudes of both neighbours over that of the peak, of tones beside the grid."""
    offsets = np.linspace(-0.5, 0.5, 11)
    cells = offsets[:, None] + np.array([-1, 0, 1])
    phase = np.outer(cells / n_bins, np.arange(weights.size))
    amplitude = abs(np.exp(2j * np.pi * phase) @ weights).reshape(cells.shape)
    return np.asarray((amplitude[:, 0] + amplitude[:, 2]) / amplitude[:, 1])


def _is_product_of_small_primes(number: int) -> bool:
    """Return whether a number is a product of 2, 3 and 5, as lengths of padded FFTs are."""
    for prime in (2, 3, 5):
        while number % prime == 0:
            number //= prime
    return number == 1
