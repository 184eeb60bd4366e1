"""A reflector in front of an IWR1843, recorded by a DCA1000."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.processing.maps import range_spectrum
from dechirp.recordings.recording import open as open_recording
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_SHAPE = (20, 3, 4, 512)  # frames, chirps, receivers and samples of the authors' settings


class Iwr1843Reflector(Witness):
    """Samples against a plain decoding, and the range of the reflector."""

    folder: ClassVar[str] = "iwr1843_reflectors"
    source: ClassVar[str] = "hailanzs/comm-proj-radar 7d268da, reflector at 5 to 10 cm"
    licence: ClassVar[str] = "no licence"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare all samples, read without an option, and the strongest range."""
        path = folder / "1_Raw_0.bin"
        recording = open_recording(path)
        # Two lanes: I of two samples, then Q of them, one receiver after the other.
        words = np.fromfile(path, "<i2").reshape(*_SHAPE[:3], 256, 2, 2)
        samples = (words[..., 0, :] + 1j * words[..., 1, :]).reshape(_SHAPE)
        ours = recording.cube.values * 2**15
        yield compare_arrays(
            f"{2 * samples.size} samples, the pair farthest apart",
            np.stack([samples.real, samples.imag]),
            np.stack([ours.real, ours.imag]),
            unit="1",
            basis="identical to plain NumPy",
            answer="own",
        )
        power = (np.abs(range_spectrum(ours)) ** 2).mean(axis=(0, 1, 2))
        bins_m = recording.radar.frame.chirp.range_bins_m(power.size)
        yield Comparison(
            quantity="range of the reflector before the offset of the board is taken off",
            theirs=0.17,
            ours=float(bins_m[power.argmax()]),
            unit="m",
            tolerance=float(bins_m[1] - bins_m[0]) / 2,
            basis="half a range cell",
        )
