"""Spectra, maps and targets of TI's mmwavelib: two simulated frames and a recorded office."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from dechirp.processing.angle.plain_arrays import estimate_directions
from dechirp.processing.maps import range_doppler_map, range_doppler_spectrum, range_spectrum
from dechirp.witnesses.base import Comparison, Witness, compare_arrays
from dechirp.witnesses.byte_reader import ByteReader

_N_RANGE, _N_CHIRPS = 256, 32
# TI's own limit for its 16-bit FFT, against its reference in real and imaginary part.
_FFT_LIMIT = 12.0
# Logarithms below 64 = 2^6 are rounding errors of 16-bit spectra.
_MIN_LOG2 = 6.0
# TI's own limit: 77 in its 1/256, of a logarithm to base 2 by a short table.
_LOG2_LIMIT = 77 / 256


class TiChain(Witness):
    """Range spectra, logarithmic powers, cells of targets and a direction."""

    folder: ClassVar[str] = "ti_mmwavelib"
    source: ClassVar[str] = "TI mmWave SDK 1.2, mmwavelib test data of the processing chain"
    licence: ClassVar[str] = "BSD-3-Clause"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare both frames in integers, the frame in floating point, powers and windows."""
        for title, name, n_rx in (
            ("recorded office", "radarDemo_captured", 4),
            ("three simulated targets", "radarDemo_multiObj", 8),
        ):
            frame = _read_integer_frame(folder, name, n_rx)
            yield from _compare_spectra(title, frame)
            yield from _compare_target_cells(title, frame)
        yield from _compare_floating_point_frame(folder / "floatPoint_chain_test.bin")
        yield _compare_summed_powers(folder / "accumPowerFlt_test.bin")
        yield _compare_windowed_samples(folder / "windowFlt_test.bin")


class _IntegerFrame(NamedTuple):
    samples: np.ndarray
    """Complex (rx, chirp, sample)."""
    range_spectra: np.ndarray
    """TI's, complex (rx, chirp, range)."""
    log2_magnitudes: np.ndarray
    """TI's, (rx, range, velocity)."""
    target_cells: np.ndarray
    """TI's, (target, 2): rows of velocity, and ranges."""


def _read_integer_frame(folder: Path, name: str, n_rx: int) -> _IntegerFrame:
    reference = ByteReader(folder / f"{name}_ref.bin")
    n_targets = reference.read_one("<u2")
    target_cells = reference.read("<u2", 2, n_targets).T
    file = ByteReader(folder / f"{name}_test.bin")
    file.read("<i2", _N_RANGE // 2)  # halves of both windows, rectangular
    file.read("<i4", _N_CHIRPS // 2)
    pairs, logarithms = [], []
    for _ in range(n_rx):
        pairs.append(_complex(file.read("<i2", _N_CHIRPS, 2, _N_RANGE, 2)))
        logarithms.append(file.read("<u2", _N_RANGE, _N_CHIRPS) / 256)
    samples, spectra = np.moveaxis(np.array(pairs), 2, 0)
    return _IntegerFrame(samples, spectra, np.array(logarithms), target_cells)


def _compare_spectra(title: str, frame: _IntegerFrame) -> Iterator[Comparison]:
    ours = range_spectrum(frame.samples, "rectangular") * _N_RANGE
    # TI's transform divides by 8; its first value is left out of TI's test as well.
    theirs = frame.range_spectra[..., 1:]
    yield compare_arrays(
        f"{title}: {theirs.size} values of range spectra, part farthest apart",
        np.stack([theirs.real, theirs.imag]),
        np.stack([ours.real, ours.imag])[..., 1:] / 8,
        unit="1",
        absolute=_FFT_LIMIT,
        basis="TI's own limit for 16-bit spectra",
    )
    spectrum = range_doppler_spectrum(frame.samples, "rectangular") * _N_RANGE * _N_CHIRPS / 8
    magnitudes = np.abs(np.fft.ifftshift(spectrum, axes=1)).transpose(0, 2, 1)
    is_clear = (frame.log2_magnitudes > _MIN_LOG2) & (np.arange(_N_CHIRPS) > 0)
    is_clear[:, 0] = False
    yield compare_arrays(
        f"{title}: {is_clear.sum()} logarithmic magnitudes, to base 2",
        frame.log2_magnitudes[is_clear],
        np.log2(magnitudes[is_clear]),
        unit="1",
        absolute=_LOG2_LIMIT,
        basis="TI's own limit for its table of logarithms",
    )


def _compare_target_cells(title: str, frame: _IntegerFrame) -> Iterator[Comparison]:
    """Compare the cells of targets with the peak that lies nearest."""
    power = np.fft.ifftshift(range_doppler_map(frame.samples, "rectangular"), axes=0)
    for number, (row, cell) in enumerate(frame.target_cells.tolist(), 1):
        rows = np.arange(row - 2, row + 3) % _N_CHIRPS
        cells = np.arange(max(cell - 2, 0), min(cell + 3, _N_RANGE))
        nearby = power[np.ix_(rows, cells)]
        peak_row, peak_cell = np.unravel_index(nearby.argmax(), nearby.shape)
        for axis, theirs, ours in (
            ("range", cell, cells[peak_cell]),
            ("velocity", row, rows[peak_row]),
        ):
            yield Comparison(
                quantity=f"{title}: {axis} cell of target {number}",
                theirs=theirs,
                ours=int(ours),
                unit="1",
                tolerance=0.5,
                basis="half a cell",
            )


def _compare_floating_point_frame(path: Path) -> Iterator[Comparison]:
    """Compare the strongest cell and its direction with TI's `radarDemo_ref_new.bin`."""
    file = ByteReader(path)
    file.read("<i2", _N_RANGE // 2 + _N_CHIRPS)  # halves of both windows, rectangular
    samples = _complex(file.read("<i2", 8, _N_CHIRPS, _N_RANGE, 2))
    spectrum = np.fft.ifftshift(range_doppler_spectrum(samples, "rectangular"), axes=1)
    power = (np.abs(spectrum) ** 2).sum(axis=0)
    row, cell = (int(index) for index in np.unravel_index(power.argmax(), power.shape))
    title = "a target in noise"
    for axis, theirs, ours in (("range", 52, cell), ("velocity", 15, row)):
        yield Comparison(
            quantity=f"{title}: {axis} cell",
            theirs=theirs,
            ours=ours,
            unit="1",
            tolerance=0.5,
            basis="half a cell",
        )
    wavelengths = np.arange(8) / 2
    directions = estimate_directions(spectrum[:, row, cell], wavelengths, 1, "bartlett")
    yield Comparison(
        quantity=f"{title}: azimuth",
        theirs=23.0,
        ours=float(np.degrees(directions.azimuth_rad.item())),
        unit="deg",
        tolerance=1.0,
        basis="TI's own limit, the step of its search",
    )


def _compare_summed_powers(path: Path) -> Comparison:
    """Compare the powers that are summed over receivers; ours is the mean map times the number."""
    file = ByteReader(path)
    theirs, ours = [], []
    for size in file.read("<u4", file.read_one("<u4")):
        values = file.read("<f4", 8, size, 2)
        spectra = values[..., 0] + 1j * values[..., 1]
        for n_rx in (1, 2, 4, 8):
            theirs.append(file.read("<f4", size))
            # A map of one chirp and one sample a channel is the mean power over the channels.
            cells = spectra[:n_rx].T[:, :, None, None]
            ours.append(
                n_rx * np.array([range_doppler_map(cell, "rectangular").item() for cell in cells])
            )
    return compare_arrays(
        f"{sum(part.size for part in theirs)} powers summed over one to eight receivers",
        np.concatenate(theirs),
        np.concatenate(ours),
        unit="1",
        relative=1e-6,
        basis="single precision of both, 1e-6",
    )


def _compare_windowed_samples(path: Path) -> Comparison:
    """Compare windowed, zero-padded samples with the reference formula of TI's test.

    The file contains samples and the first halves of symmetric windows; TI's test computes their
    products. Ours are the samples whose spectrum is the range spectrum.
    """
    file = ByteReader(path)
    theirs, ours = [], []
    for n_bins in file.read("<u4", file.read_one("<u4")).tolist():
        sizes = file.read("<u4", file.read_one("<u4")).tolist()
        codes = _complex(file.read("<i2", n_bins, 2))
        for size in sizes:
            half = file.read("<i2", (size + 1) // 2)
            window = np.concatenate([half, half[: size // 2][::-1]]) / 32768
            products = np.zeros(n_bins, complex)
            products[:size] = codes[:size] * window
            spectrum = range_spectrum(codes[:size], window, n_bins=n_bins)
            theirs.append(products)
            ours.append(np.fft.ifft(spectrum) * window.sum())
    parts = [np.concatenate(arrays).view(float) for arrays in (theirs, ours)]
    return compare_arrays(
        f"{parts[0].size // 2} windowed samples, windows of TI on TI's samples",
        *parts,
        unit="1",
        absolute=1e-6 * float(np.abs(parts[0]).max()),
        basis="single precision, 1e-6 of the largest; theirs by the formula of TI's test",
        answer="own",
    )


def _complex(parts: np.ndarray) -> np.ndarray:
    return parts[..., 0] + 1j * parts[..., 1]
