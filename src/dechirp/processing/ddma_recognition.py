"""Recognition of Doppler-division multiplexing: used sub-bands and transmit order.

Under Doppler division each echo appears once in each used sub-band. The cyclic autocorrelation of
the Doppler spectra therefore has peaks at multiples of the width of a sub-band. The sub-bands of an
echo are those of the transmitters, shifted by its velocity: static echoes show them without shift.
Which transmitter has which sub-band follows from the array: only in the true order are the channels
of an echo the response to a plane wave.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_samples, check_number
from dechirp.core.values import frozen_dataclass
from dechirp.radar.array import Array
from dechirp.radar.multiplexing.ddma import Ddma

_MIN_BAND_BINS = 4
_MIN_PEAK_SNR = 100.0
_PEAK_RANGE = 10**-2.5  # sidelobes of the Hann window lie 31 dB below a peak
_MAX_CELLS = 400
_MAX_FITTED_CELLS = 30  # with the steps of the grid, below 64 MiB
_MIN_LAG_SHARE = 0.1
_LAG_THRESHOLD = 0.3
_MIN_GAP = 4.0
"""Ratio of mean powers between the weakest used and the strongest empty sub-band."""
_MAX_ORDERED_TRANSMITTERS = 6
_MIN_WAVE_FIT = 0.8
_GRID_LOSS = 0.02
"""Share of the power that a wave between the directions of the grid loses."""
_MIN_LEAD = 5.0
"""Logarithm of the ratio by which the residuals of all echoes together must be smaller than those
of the next order."""


@frozen_dataclass
class RecognisedDdma:
    """Doppler division recognised in samples."""

    multiplexing: Ddma
    is_static_band_known: bool
    """Whether static echoes show which sub-band has no shift; else velocities may be wrong by
    whole sub-bands."""
    is_order_known: bool
    """Whether the array tells the transmitters apart; else they have ascending sub-bands."""
    wave_fit: float
    """Share of the power of the strongest echoes that plane waves explain; 1 in theory, NaN if
    the array has another number of transmitters."""


@check_argument_types
def recognise_ddma(
    samples: xr.DataArray | np.ndarray, array: Array, wavelength_m: float
) -> RecognisedDdma | None:
    """Recognise the sub-bands and the transmit order of Doppler division from one frame.

    Parameters
    ----------
    samples : array (chirp, rx, sample), or cube with one frame
        All chirps of a frame in order.
    array : Array
        Positions of the antennas.
    wavelength_m : float
        As `Chirp.wavelength_m`.

    Returns
    -------
    RecognisedDdma, or None
        None if echoes do not repeat in sub-bands.

    Raises
    ------
    InvalidSetting
        If the samples are not finite numbers or have another shape.

    References
    ----------
    F. Jansen, Automotive radar Doppler division MIMO, EuRAD 2019.
    """
    check_number("wavelength_m", wavelength_m, above=0.0)
    if isinstance(samples, xr.DataArray) and samples.ndim == 4 and len(samples):
        samples = samples[0]
    chirps = check_finite_samples(
        "samples",
        samples,
        axes=f"(chirp, rx, sample) of one frame, with {array.n_rx} receivers",
        fits=lambda chirps: chirps.ndim == 3 and chirps.shape[1] == array.n_rx,
    )
    spectrum = _range_doppler_spectrum(chirps)
    power = np.sum(spectrum.real**2 + spectrum.imag**2, axis=1, dtype=float)
    is_peak = _doppler_peak_mask(power)
    band_bins = _sub_band_width(power, is_peak)
    if band_bins is None:
        return None
    choices = [_collect_cells(power, is_peak, width) for width in _possible_widths(band_bins)]
    most = max(choice.excess_of_static for choice in choices)
    # Widths are ordered: the smaller ones have the static echoes of the larger one, too.
    cells = next(choice for choice in choices if choice.excess_of_static >= 0.5 * most)
    bands, shifts = _used_bands_and_shifts(cells)
    if len(bands) < 2:
        return None
    band_bins, n_bands = cells.band_bins, len(power) // cells.band_bins
    static_shift = _most_frequent(shifts[cells.is_static])
    sub_bands = np.sort((bands + (static_shift or 0)) % n_bands)
    amplitudes = _band_amplitudes(
        spectrum, cells, (sub_bands + (shifts - (static_shift or 0))[:, None]) % n_bands
    )
    fit = _transmit_order(amplitudes, array, wavelength_m)
    return RecognisedDdma(
        multiplexing=Ddma(
            order=fit.order,
            n_sub_bands=n_bands,
            sub_bands=tuple(int(band) for band in sub_bands),
            is_order_known=fit.is_unique,
        ),
        is_static_band_known=static_shift is not None,
        is_order_known=fit.is_unique,
        wave_fit=fit.share,
    )


class _Cells(NamedTuple):
    """Range cells with an echo, at one place of each sub-band."""

    doppler: np.ndarray
    """Doppler bin within the sub-band."""
    range: np.ndarray
    band_power: np.ndarray
    """(cell, band), of sum 1."""
    band_bins: int

    @property
    def is_static(self) -> np.ndarray:
        """True for cells in which a static echo of some transmitter could be."""
        return np.asarray(np.minimum(self.doppler, self.band_bins - self.doppler) <= 1)

    @property
    def excess_of_static(self) -> float:
        """Share of such cells above that of evenly distributed velocities."""
        return float(self.is_static.mean()) - 3 / self.band_bins


def _range_doppler_spectrum(chirps: np.ndarray) -> np.ndarray:
    """Return (doppler, rx, range); of real samples the positive beat frequencies."""
    import scipy  # unused where another format is opened

    n_chirps, _, n_samples = chirps.shape
    # Sidelobes 58 dB down: each of a strong echo would count as one more of its velocity.
    window = np.blackman(n_samples + 2)[1:-1].astype(np.float32)
    slow_window = np.hanning(n_chirps + 2)[1:-1, None, None].astype(np.float32)
    # SciPy transforms several series at once: a quarter of the time of NumPy.
    is_complex = np.iscomplexobj(chirps)
    windowed = chirps * window
    ranges = scipy.fft.fft(windowed, axis=2) if is_complex else scipy.fft.rfft(windowed, axis=2)
    ranges *= slow_window
    return np.asarray(scipy.fft.fft(ranges, axis=0, overwrite_x=True))


def _doppler_peak_mask(power: np.ndarray) -> np.ndarray:
    """Return True for strong local maxima over Doppler and range."""
    is_maximum = (power > np.roll(power, 1, axis=0)) & (power >= np.roll(power, -1, axis=0))
    is_maximum[:, 1:] &= power[:, 1:] > power[:, :-1]
    is_maximum[:, :-1] &= power[:, :-1] >= power[:, 1:]
    least = np.maximum(_MIN_PEAK_SNR * np.median(power), _PEAK_RANGE * power.max(axis=0))
    return np.asarray(is_maximum & (power > least))


def _sub_band_width(power: np.ndarray, is_peak: np.ndarray) -> int | None:
    """Return the number of Doppler bins of a sub-band, or None if echoes do not repeat."""
    if not is_peak.any():
        return None
    n_chirps = len(power)
    amplitude = np.sqrt(np.where(is_peak, power, 0.0))
    strongest = np.argsort(power.max(axis=0))[-_MAX_CELLS:]
    amplitude = amplitude[:, strongest]
    amplitude = amplitude / np.maximum(np.linalg.norm(amplitude, axis=0), np.finfo(float).tiny)
    correlation = np.fft.ifft(np.abs(np.fft.fft(amplitude, axis=0)) ** 2, axis=0).real.sum(axis=1)
    lags = np.arange(n_chirps)
    is_far = np.minimum(lags, n_chirps - lags) >= _MIN_BAND_BINS
    if not is_far.any() or correlation[is_far].max() < _MIN_LAG_SHARE * correlation[0]:
        return None
    is_high = is_far & (correlation > _LAG_THRESHOLD * correlation[is_far].max())
    total = correlation[is_high].sum()
    for n_bands in range(2, n_chirps // _MIN_BAND_BINS + 1):
        if n_chirps % n_bands == 0:
            width = n_chirps // n_bands
            if correlation[is_high & (lags % width == 0)].sum() >= 0.9 * total:
                return width
    return None


def _collect_cells(power: np.ndarray, is_peak: np.ndarray, band_bins: int) -> _Cells:
    n_chirps, n_ranges = power.shape
    doppler, range_bin = np.nonzero(is_peak)
    unique = np.unique(range_bin * band_bins + doppler % band_bins)
    range_bin, doppler = np.divmod(unique, band_bins)
    by_band = power.reshape(n_chirps // band_bins, band_bins, n_ranges)[:, doppler, range_bin].T
    total = by_band.sum(axis=1)
    strongest = np.argsort(total)[::-1][:_MAX_CELLS]
    return _Cells(
        doppler[strongest],
        range_bin[strongest],
        by_band[strongest] / total[strongest, None],
        band_bins,
    )


def _possible_widths(spacing_bins: int) -> list[int]:
    """Return the widths of sub-bands whose multiple is the spacing of the used ones.

    Sub-bands 1 and 3 of 4 are 2 apart; without shift, static echoes would be in neither.
    """
    widths = [spacing_bins // n for n in (1, 2, 4, 8) if spacing_bins % n == 0]
    return [width for width in widths if width >= _MIN_BAND_BINS]


def _used_bands_and_shifts(cells: _Cells) -> tuple[np.ndarray, np.ndarray]:
    """Return the sub-bands in use, up to a common shift, and the shift of each cell from them."""
    n_bands = cells.band_power.shape[1]
    rotations = (np.arange(n_bands)[:, None] + np.arange(n_bands)) % n_bands  # (shift, band)
    amplitude = np.sqrt(cells.band_power)
    mean = cells.band_power[0]
    for _ in range(5):
        likeness = np.einsum("csb,b->cs", amplitude[:, rotations], np.sqrt(mean))
        shifts = likeness.argmax(axis=1)
        aligned = np.take_along_axis(cells.band_power, rotations[shifts], axis=1)
        # Most cells have one echo; the mean would show the sub-bands of a second one.
        mean = np.median(aligned, axis=0)
    ranked = np.sort(mean)[::-1]
    gaps = ranked[:-1] / np.maximum(ranked[1:], np.finfo(float).tiny)
    n_used = int(gaps.argmax()) + 1 if gaps.max() >= _MIN_GAP else n_bands
    bands = np.sort(np.argsort(mean)[::-1][:n_used])
    period = next(  # of a symmetric pattern, whose shifts are known modulo this
        shift
        for shift in range(1, n_bands + 1)
        if np.array_equal(np.sort((bands + shift) % n_bands), bands)
    )
    return bands, shifts % period


def _most_frequent(shifts: np.ndarray) -> int | None:
    return int(np.bincount(shifts).argmax()) if shifts.size else None


def _band_amplitudes(spectrum: np.ndarray, cells: _Cells, bands: np.ndarray) -> np.ndarray:
    """Return (cell, transmitter, rx) of the strongest cell at each range."""
    _, first = np.unique(cells.range, return_index=True)
    first = np.sort(first)[:_MAX_FITTED_CELLS]
    rows = cells.doppler[first, None] + bands[first] * cells.band_bins
    return np.asarray(spectrum[rows, :, cells.range[first, None]])


class _OrderFit(NamedTuple):
    order: tuple[int, ...]
    is_unique: bool
    share: float


def _transmit_order(amplitudes: np.ndarray, array: Array, wavelength_m: float) -> _OrderFit:
    """Return the transmitter of each ascending sub-band for which plane waves fit best."""
    n_tx = amplitudes.shape[1]
    ascending = tuple(range(n_tx))
    if len(array.tx_m) != n_tx or n_tx > _MAX_ORDERED_TRANSMITTERS:
        return _OrderFit(ascending, False, math.nan)
    steering = _grid_steering(array, wavelength_m)
    total = np.sum(np.abs(amplitudes) ** 2, axis=(1, 2))
    # (band, transmitter, cell, direction): each band received with the response of each one.
    products = np.tensordot(amplitudes, steering.conj().astype(amplitudes.dtype), axes=(2, 2))
    responses = np.ascontiguousarray(products.transpose(1, 3, 0, 2))
    orders = list(itertools.permutations(ascending))
    cell_shares = np.empty((len(orders), len(amplitudes)))
    for index, order in enumerate(orders):
        beams = responses[np.arange(n_tx), order].sum(axis=0)
        cell_shares[index] = np.max(beams.real**2 + beams.imag**2, axis=1)
    cell_shares /= n_tx * array.n_rx * total
    shares = np.median(cell_shares, axis=1)
    evidence = -np.sum(np.log(1 - cell_shares + _GRID_LOSS), axis=1)
    best = int(evidence.argmax())
    lead = evidence[best] - np.max(np.delete(evidence, best), initial=-np.inf)
    is_unique = bool(shares[best] >= _MIN_WAVE_FIT and lead >= _MIN_LEAD)
    return _OrderFit(orders[best] if is_unique else ascending, is_unique, float(shares[best]))


def _grid_steering(array: Array, wavelength_m: float) -> np.ndarray:
    """Return (direction, tx, rx): responses to plane waves, 16 directions from null to null."""
    positions = array.virtual_positions_m / wavelength_m
    extents = np.ptp(positions, axis=0)[1:]
    most = 400 if extents.min() < 1e-3 else 60
    n_steps = [min(2 * math.ceil(8 * extent), most) for extent in extents]
    cosines = [np.arange(-n, n + 1, 2) / max(n, 1) for n in n_steps]
    y, z = (axis.ravel() for axis in np.meshgrid(*cosines))
    is_visible = y**2 + z**2 <= 1
    y, z = y[is_visible], z[is_visible]
    x = np.sqrt(np.maximum(1 - y**2 - z**2, 0))
    phase = 2 * np.pi * np.stack([x, y, z], axis=1) @ positions.T
    return np.asarray(np.exp(-1j * phase).reshape(len(y), len(array.tx_m), array.n_rx))
