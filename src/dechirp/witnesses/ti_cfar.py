"""CFAR levels and peaks of TI's mmwavelib."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.processing.cfar.plain_arrays import cfar_threshold
from dechirp.theory.cfar_kinds import CfarKind, cfar_factor
from dechirp.witnesses.base import Comparison, Witness, compare_arrays
from dechirp.witnesses.byte_reader import ByteReader

_PFA = 1e-3  # any: the factor is divided out
# Kinds in the order of TI's files.
_KINDS: dict[str, CfarKind] = {
    "cell averaging": "cell-averaging",
    "cell accumulation": "cell-averaging",
    "smallest of": "smallest-of",
    "greatest of": "greatest-of",
}
# TI's threshold over the level in its test of peaks.
_PEAK_FACTORS = {"cell averaging": 7.0, "smallest of": 14.0, "greatest of": 7.0}


class TiCfar(Witness):
    """Noise levels of four CFAR kinds, with ends and round the end, and the detected peaks."""

    folder: ClassVar[str] = "ti_mmwavelib"
    source: ClassVar[str] = "TI mmWave SDK 1.2, mmwavelib test data of CFAR"
    licence: ClassVar[str] = "BSD-3-Clause"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare levels away from the ends, levels round the end, and peaks."""
        between = _levels_between_ends(folder / "cfarca_test.bin")
        round_the_end = _levels_round_the_end(folder / "cfarca_wrap_test.bin")
        for place, levels in (("", between), (" round the end", round_the_end)):
            for name, (theirs, ours) in levels.items():
                yield compare_arrays(
                    f"{name}{place}, {theirs.size} levels",
                    theirs,
                    ours,
                    unit="1",
                    basis="single precision of both, 1e-6 of the level",
                    relative=1e-6,
                )
        n_peaks, n_same = _count_same_peaks(folder / "cfarca_peak_test.bin")
        yield Comparison(
            quantity="peaks found by three kinds, and no others",
            theirs=n_peaks,
            ours=n_same,
            unit="1",
            tolerance=0,
            basis="the same detections",
        )


def _levels_between_ends(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return TI's and our levels by kind, of cells with training cells on both sides.

    At the ends of the searched cells TI copies the level of the other side; dechirp takes the
    nearest cells that exist.
    """
    file = ByteReader(path)
    sizes = file.read("<u4", file.read_one("<u4"))
    pairs = _empty_pairs()
    for size in sizes:
        n_cases = file.read_one("<u4")
        power = file.read("<f4", size)
        for _ in range(n_cases):
            left, right, guard, training = (int(number) for number in file.read("<u4", 4))
            searched = power[left : size - right]
            inner = slice(guard + training, len(searched) - guard - training)
            for name in _KINDS:
                theirs = file.read("<f4", len(searched))
                ours = _noise_levels(searched, name, training, guard)
                pairs[name].append((theirs[inner], ours[inner]))
    return _join_pairs(pairs)


def _levels_round_the_end(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return TI's and our levels by kind, with training cells that continue at the other end."""
    file = ByteReader(path)
    sizes = file.read("<u4", file.read_one("<u4"))
    pairs = _empty_pairs()
    for size in sizes:
        n_cases = file.read_one("<u4")
        power = file.read("<f4", size)
        for _ in range(n_cases):
            guard, training = (int(number) for number in file.read("<u4", 2))
            for name in _KINDS:
                # Velocity continues at the other end, range does not.
                ours = _noise_levels(power[:, None], name, (training, 0), (guard, 0))[:, 0]
                pairs[name].append((file.read("<f4", size), ours))
    return _join_pairs(pairs)


def _empty_pairs() -> dict[str, list[tuple[np.ndarray, np.ndarray]]]:
    return {name: [] for name in _KINDS}


def _join_pairs(
    pairs: dict[str, list[tuple[np.ndarray, np.ndarray]]],
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    joined = {}
    for name, parts in pairs.items():
        theirs, ours = zip(*parts, strict=True)
        joined[name] = np.concatenate(theirs), np.concatenate(ours)
    return joined


def _count_same_peaks(path: Path) -> tuple[int, int]:
    """Return the number of TI's peaks, and of ours that are the same, less those that are not."""
    file = ByteReader(path)
    n_peaks, n_same = 0, 0
    for size in file.read("<u4", file.read_one("<u4")):
        left, right, guard, training = (int(number) for number in file.read("<u4", 4))
        power = file.read("<f4", size)
        peaks = set(file.read("<u4", file.read_one("<u4")).tolist())
        searched = power[left : size - right]
        for name in ("cell averaging", "smallest of", "greatest of"):
            threshold = _PEAK_FACTORS[name] * _noise_levels(searched, name, training, guard)
            ours = {left + int(cell) for cell in np.flatnonzero(searched > threshold)}
            n_peaks += len(peaks)
            n_same += len(peaks & ours) - len(ours - peaks)
    return n_peaks, n_same


def _noise_levels(
    power: np.ndarray, name: str, n_training: int | tuple[int, int], n_guard: int | tuple[int, int]
) -> np.ndarray:
    """Return the noise level of each cell: the threshold over its factor."""
    n_both_sides = 2 * int(np.sum(n_training))
    kind = _KINDS[name]
    threshold = cfar_threshold(power, n_training, n_guard, _PFA, kind)
    levels = threshold / cfar_factor(_PFA, n_both_sides, kind=kind)
    return levels * n_both_sides if name == "cell accumulation" else levels
