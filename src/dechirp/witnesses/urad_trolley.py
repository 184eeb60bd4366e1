"""uRAD recordings of a moving trolley, I and Q in one file and in two."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.recordings.recording import open as open_recording
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_N_SAMPLES, _N_BINS = 200, 512
_FULL_SCALE = 4095  # 12 bits


class UradTrolley(Witness):
    """Samples against a plain decoding, and the track of the trolley."""

    folder: ClassVar[str] = "urad_sweeps"
    source: ClassVar[str] = "dayalannair/FMCW_FFT_Radar a0ee774, uRAD sweeps"
    licence: ClassVar[str] = "no licence"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare both layouts, opened without an option."""
        single = [folder / "IQ_0_1024_sweeps.txt"]
        halves = [folder / "I_trolley_test.txt", folder / "Q_trolley_test.txt"]
        for title, files in (("I and Q in one file", single), ("in two files", halves)):
            recording = open_recording(files[0])
            ours = recording.cube.values.reshape(-1, _N_SAMPLES)
            theirs = _decode_up_ramps(files)
            yield compare_arrays(
                f"{title}: {2 * theirs.size} samples, the pair farthest apart",
                np.stack([theirs.real, theirs.imag]),
                np.stack([ours.real, ours.imag]),
                unit="1",
                absolute=3e-7,
                basis="single precision of full scale",
                answer="own",
            )
        yield Comparison(
            quantity="mean time between sweeps, from the times in the file",
            theirs=14.582 / 343,
            ours=recording.radar.frame.single_interval_s,
            unit="s",
            tolerance=1e-3 * 14.582 / 343,
            basis="1e-3, times in milliseconds",
            answer="own",
        )
        spectra = np.abs(np.fft.fft(ours - ours.mean(axis=0), _N_BINS)[:, 4:100])
        cells = spectra.argmax(axis=1) + 4
        for title, sweeps, theirs_cell in (
            ("before it starts", slice(40, 50), 34),
            ("nearest to the radar", slice(140, 200), 8),
            ("back again", slice(315, 335), 31),
        ):
            yield Comparison(
                quantity=f"trolley {title}: cell of {_N_BINS}",
                theirs=theirs_cell,
                ours=float(np.median(cells[sweeps])),
                unit="1",
                tolerance=_N_BINS / _N_SAMPLES,
                basis="a range cell",
                answer="own",
            )


def _decode_up_ramps(files: list[Path]) -> np.ndarray:
    """Return I + j Q of the up-ramps, (line, sample), from -1 to 1: I and Q, each up and down."""
    lines = [[line.split()[:-1] for line in file.read_text().splitlines()] for file in files]
    codes = np.concatenate([np.array(file_lines, np.int64) for file_lines in lines], axis=1)
    in_phase = codes[:, :_N_SAMPLES]
    quadrature = codes[:, 2 * _N_SAMPLES : 3 * _N_SAMPLES]
    return (in_phase + 1j * quadrature) * 2 / _FULL_SCALE - (1 + 1j)
