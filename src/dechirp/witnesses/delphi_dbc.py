"""Messages of a Delphi ESR radar, by the layout of its DBC."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.results.object_lists.can_frames import CanFrame
from dechirp.results.object_lists.can_mapping import read_vendor_layout
from dechirp.results.object_lists.vendor_lists import assemble_vendor_list
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_FIRST_IDENTIFIER, _N_TRACKS, _N_LISTS = 1280, 64, 20
_UPDATED = 2  # code of the status of a track that is measured
_SIGNALS = ("RANGE", "ANGLE", "RANGE_RATE")


class DelphiDbc(Witness):
    """Random tracks, decoded by plain arithmetic on the bits that the DBC states."""

    folder: ClassVar[str] = "car_dbc"
    source: ClassVar[str] = "commaai/opendbc 7343a66, ESR.dbc"
    licence: ClassVar[str] = "MIT"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare range, azimuth and range rate of every track."""
        text = (folder / "ESR.dbc").read_text(encoding="latin-1")
        layout = read_vendor_layout(folder / "ESR.dbc", "delphi-esr")
        rng = np.random.default_rng(1)
        frames, theirs = [], []
        for index in range(_N_LISTS):
            for track in range(_N_TRACKS):
                bits = rng.integers(0, 2, 64)
                _write_signal(bits, _find_signal(text, track, "STATUS"), _UPDATED)
                _write_signal(bits, _find_signal(text, track, "ROLLING_COUNT"), index % 2)
                identifier = _FIRST_IDENTIFIER + track
                data = np.packbits(bits).tobytes()
                frames.append(CanFrame(0.05 * index + 1e-4 * track, identifier, False, data))
                theirs.append([_decode(bits, _find_signal(text, track, name)) for name in _SIGNALS])
        objects = assemble_vendor_list(frames, layout)
        order = np.lexsort((objects["number"].values, objects["frame"].values))
        x, y, vx, vy = (objects[name].values[order] for name in ("x", "y", "vx", "vy"))
        range_m, azimuth_deg, range_rate = np.transpose(theirs)
        yield Comparison(
            quantity=f"tracks in {_N_LISTS} lists",
            theirs=len(theirs),
            ours=len(x),
            unit="1",
            tolerance=0,
            basis="equal",
            answer="own",
        )
        azimuth = np.radians(azimuth_deg)  # positive to the right
        away = np.stack([np.cos(azimuth), -np.sin(azimuth)])
        for name, expected, ours in (
            ("positions, m", range_m * away, np.stack([x, y])),
            ("velocities, m/s", range_rate * away, np.stack([vx, vy])),
        ):
            if len(x) == len(theirs):
                unit = name.rpartition(" ")[2]
                yield compare_arrays(
                    f"{name.partition(',')[0]} of all tracks, the pair farthest apart",
                    expected,
                    ours,
                    unit=unit,
                    absolute=1e-9,
                    basis="rounding",
                    answer="own",
                )


def _find_signal(text: str, track: int, name: str) -> tuple[int, int, bool, float, float]:
    """Return start, length, sign, factor and offset of a big-endian signal of a track."""
    message = re.search(rf"BO_ {_FIRST_IDENTIFIER + track} .*?(?=\nBO_ )", text, re.DOTALL)
    match = message and re.search(
        rf"SG_ CAN_TX_TRACK_{name} : (\d+)\|(\d+)@0([+-]) \(([^,]+),([^)]+)\)", message[0]
    )
    if not match:
        raise ValueError(f"ESR.dbc: no signal CAN_TX_TRACK_{name} of track {track}")
    start, length, sign, factor, offset = match.groups()
    return int(start), int(length), sign == "-", float(factor), float(offset)


def _bit_indices(start: int, length: int) -> np.ndarray:
    """Return the indices of a big-endian signal among the bits in the order of transmission."""
    return 8 * (start // 8) + 7 - start % 8 + np.arange(length)


def _write_signal(bits: np.ndarray, signal: tuple[int, int, bool, float, float], code: int) -> None:
    start, length, *_ = signal
    bits[_bit_indices(start, length)] = [
        code >> (length - 1 - index) & 1 for index in range(length)
    ]


def _decode(bits: np.ndarray, signal: tuple[int, int, bool, float, float]) -> float:
    start, length, is_signed, factor, offset = signal
    number = int("".join(map(str, bits[_bit_indices(start, length)].tolist())), 2)
    if is_signed and number >= 1 << (length - 1):
        number -= 1 << length
    return number * factor + offset
