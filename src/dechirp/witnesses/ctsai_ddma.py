"""Calterah radar with four transmitters at once: Doppler division that no file names."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.processing.detect import detect
from dechirp.recordings.recording import open as open_recording
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_N_CHIRPS, _N_SAMPLES = 128, 2048
"""Profile 1. In chirps of 1,024 samples, the echoes would be in eight of sixteen sub-bands."""
_BAND_BINS = 16
_SUB_BANDS = (0, 1, 4, 6)
"""Sub-bands of the strongest lines in the Doppler spectrum, by plain NumPy."""
_STRONGEST = 5
_ORDER = (
    "the settings file places two transmitters at one point, where two sub-bands would differ by"
    " one constant whatever the echoes are. No two do: over 10 to 16 echoes a receiver, 20 dB over"
    " the noise, the coherence of the phases of the likest pair is 0.43 to 0.62, 1 at one point,"
    " and it is another pair in each receiver. So its positions are not those"
    " of the recording, and nothing else tells the transmitters apart. The receivers were recorded"
    " one after another, 8 s apart: in no order do plane waves explain more than 40 % of"
    " the echoes, or 56 % with each receiver for itself. Positions and phases, fitted freely,"
    " explain the phases of 51 echoes no better than random ones: 0.80 within one wavelength, 0.75"
    " to 0.80 of random, and 0.92 within four, 0.91 to 0.93 of random. From receiver to receiver,"
    " the pattern over the sub-bands has a coherence of 0.47 to 0.64, 0.46 of random. Directions"
    " are left unknown"
)


class CtsaiDdma(Witness):
    """Samples against a plain decoding, sub-bands, and one detection a target."""

    folder: ClassVar[str] = "ctsai_ddma_near"
    source: ClassVar[str] = "Super-Radar/CTSAI-A100 9a65438, near field"
    licence: ClassVar[str] = "Apache-2.0"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the folder, opened without an option."""
        theirs = _decode_receivers([folder / f"near_rx{rx}.txt" for rx in range(4)])
        recording = open_recording(folder)
        cube = recording.cube
        ours = cube.values.reshape(_N_CHIRPS, 4, _N_SAMPLES)
        yield compare_arrays(
            f"{theirs.size} samples of four receivers, the pair farthest apart",
            theirs,
            ours * 2**15,
            unit="1",
            absolute=0.0,
            basis="equal",
            answer="own",
        )
        yield Comparison(
            quantity="samples of a chirp, by the jumps of the samples between chirps",
            theirs=_spacing_of_jumps(theirs),
            ours=recording.radar.frame.chirp.n_samples,
            unit="1",
            tolerance=0,
            basis="equal",
            answer="own",
        )
        code = recording.radar.frame.multiplexing
        bands = getattr(code, "sub_bands", None) or ()
        for theirs_number, ours_number, title in (
            (8, recording.radar.frame.n_slots, "number of sub-bands"),
            (len(_SUB_BANDS), len(bands), "transmitters"),
        ):
            yield Comparison(
                quantity=title,
                theirs=theirs_number,
                ours=ours_number,
                unit="1",
                tolerance=0,
                basis="equal",
                answer="own",
            )
        yield compare_arrays(
            "sub-bands in use",
            _SUB_BANDS,
            bands if len(bands) == len(_SUB_BANDS) else np.full(len(_SUB_BANDS), np.nan),
            unit="1",
            absolute=0.0,
            basis="equal",
            answer="own",
        )
        yield Comparison(
            quantity="transmit order, 1 if recognised",
            theirs=1,
            ours=float(getattr(code, "is_order_known", False)),
            unit="1",
            tolerance=0,
            basis="one order fits the echoes",
            cause=_ORDER,
        )
        detections = detect(cube, recording.radar)
        ranges_m, velocities = detections["range"].values, detections["velocity"].values
        n_with_angle = 0
        for cell in _strongest_cells(theirs):
            range_m = _range_of_cell_m(cell, recording.radar.frame.chirp.slope_hz_per_s)
            near = abs(ranges_m - range_m) < _range_of_cell_m(
                1, recording.radar.frame.chirp.slope_hz_per_s
            )
            n_with_angle += int(np.isfinite(detections["azimuth"].values[near]).sum() == 1)
            yield Comparison(
                quantity=f"detections at {range_m:.2f} m, four lines in the Doppler spectrum",
                theirs=1,
                ours=int(near.sum()),
                unit="1",
                tolerance=0,
                basis="one static target",
                answer="own",
            )
            yield Comparison(
                quantity=f"velocity at {range_m:.2f} m, a static target",
                theirs=0,
                ours=float(velocities[near][0]) if near.any() else np.nan,
                unit="m/s",
                tolerance=0.07,
                basis="half a Doppler cell of 0.14 m/s",
                answer="own",
            )
        yield Comparison(
            quantity=f"angles, one for each of these {_STRONGEST} targets",
            theirs=_STRONGEST,
            ours=n_with_angle,
            unit="1",
            tolerance=0,
            basis="one direction a target, not one for each of four transmitters",
            cause="angles need the transmit order, which is not recognised; see its row",
            answer="own",
        )


def _decode_receivers(files: list[Path]) -> np.ndarray:
    """Return the samples (chirp, rx, sample) with plain Python and NumPy."""
    receivers = []
    for file in files:
        words = np.array([int(number) for number in file.read_text().split(",")], np.uint32)
        words = words[: _N_CHIRPS * _N_SAMPLES // 2]
        halves = np.stack([words >> 16, words & 0xFFFF], axis=1).astype(np.uint16)
        receivers.append(halves.view(np.int16).reshape(_N_CHIRPS, _N_SAMPLES))
    return np.stack(receivers, axis=1).astype(float)


def _spacing_of_jumps(samples: np.ndarray) -> int:
    """Return the samples between the two largest second differences, in periods of 4,096."""
    series = samples.transpose(1, 0, 2).reshape(samples.shape[1], -1)
    curvature = np.abs(np.diff(series, 2, axis=1)).mean(axis=0)
    mean = np.append(curvature, [0, 0]).reshape(-1, 4096).mean(axis=0)
    first = int(mean.argmax())
    mean[max(first - 8, 0) : first + 9] = 0
    return int(abs(mean.argmax() - first))


def _strongest_cells(samples: np.ndarray) -> list[int]:
    """Return range cells of the strongest static echoes, from the lines of all sub-bands."""
    windowed = samples * np.hanning(_N_SAMPLES)
    spectrum = np.fft.fft(
        np.fft.rfft(windowed, axis=2) * np.hanning(_N_CHIRPS)[:, None, None], axis=0
    )
    power = np.sum(np.abs(spectrum[np.array(_SUB_BANDS) * _BAND_BINS]) ** 2, axis=(0, 1))
    peaks = [
        cell
        for cell in range(8, len(power) - 1)
        if power[cell] > max(power[cell - 1], power[cell + 1])
    ]
    return sorted(sorted(peaks, key=lambda cell: -power[cell])[:_STRONGEST])


def _range_of_cell_m(cell: float, slope_hz_per_s: float) -> float:
    return cell * 25e6 / _N_SAMPLES * 299792458 / (2 * slope_hz_per_s)
