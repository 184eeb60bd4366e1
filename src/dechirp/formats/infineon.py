"""Infineon recordings (ifxdaq, Radar Fusion GUI): a folder with `radar.npy` and `config.json`.

Codes of a 12-bit converter, (frame, rx, chirp, sample), of the real beat signal. They hold
the converter's offset, about 0.4 of full scale, which stays: it is part of what was sampled.
Of two transmitters in turn either all chirps lie in the order sent, or `rx` runs over the
receivers of each transmitter; the sizes tell (no real recording of them was at hand).
"""

from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told, must_stay_in
from dechirp.formats.npy import array_in
from dechirp.formats.settings.read import read_settings
from dechirp.formats.settings.receivers import with_receivers

_LARGEST_CODE = 4095
_SCALE = 1 / _LARGEST_CODE  # half a step of the converter: codes lie between whole steps
_SAMPLES, _CONFIG = "radar.npy", "config.json"


@value
class Infineon(Format):
    """Infineon recordings (ifxdaq, Radar Fusion GUI): `radar.npy` with `config.json`.

    The folder itself, the folder that holds it alone, or its `radar.npy`.
    """

    def recognise(self, path: Path) -> Fit:
        """Tell by the files of the folder."""
        return Fit.OWN if _folders(path) else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        folders = _folders(path)
        if len(folders) != 1:
            names = ", ".join(folder.name for folder in folders) or "none"
            raise RecordingError(
                path,
                got=f"a folder with {len(folders)} recordings ({names})",
                need="one recording",
                fix="Name the folder of one of them.",
            )
        settings = told.settings or read_settings(folders[0] / _CONFIG, told.device)
        file = folders[0] / _SAMPLES
        must_stay_in(folders[0], file)
        codes = array_in(file)
        frame, n_rx = settings.radar.frame, settings.radar.array.n_rx
        n_rx_told = codes.shape[1] if len(codes.shape) == 4 and n_rx == 1 else n_rx
        need = (n_rx_told, frame.n_sent, frame.chirp.n_samples)
        # Transmitters that take turns may also be sorted already: rows of both pairs of each.
        turns = frame.turns or ()
        is_sorted = len(turns) > 1 and codes.shape[1:] == (
            len(turns) * n_rx,
            frame.n_chirps,
            frame.chirp.n_samples,
        )
        if codes.dtype.kind not in "iu" or not (codes.shape[1:] == need or is_sorted):
            raise RecordingError(
                file,
                got=f"an array of {codes.dtype} of shape {codes.shape}",
                need=f"of integers of shape (frames, {', '.join(str(size) for size in need)}):"
                " rx, chirp and sample as the settings say",
                fix="Give the settings it was recorded with.",
            )
        if frame.chirp.sampling != "real":
            raise RecordingError(
                file,
                got="a recording of real samples",
                need="one whose radar.frame.chirp.sampling is real",
                fix="Set sampling: real.",
            )
        n_present = n_rx if is_sorted else codes.shape[1]
        radar, findings = with_receivers(settings.radar, n_present, file=file)

        def decode(index: int, out: np.ndarray) -> None:
            whole = (slice(0, size) for size in codes.shape[1:])
            read = codes.read((slice(index, index + 1), *whole))[0]
            in_order = _as_sent(read, turns, n_rx) if is_sorted else np.swapaxes(read, 0, 1)
            _to_full_scale(file, in_order, index, out)

        return Contents(
            radar=radar,
            n_frames=codes.shape[0],
            decode=decode,
            scale=_SCALE,
            findings=settings.findings + findings,
        )


def _folders(path: Path) -> list[Path]:
    """Folders of recordings that a path can mean."""
    if path.is_file():
        both = path.name == _SAMPLES and (path.parent / _CONFIG).is_file()
        return [path.parent] if both else []
    if (path / _SAMPLES).is_file():
        return [path]
    return sorted(file.parent for file in path.glob(f"*/{_SAMPLES}"))


def _as_sent(codes: np.ndarray, turns: tuple[int, ...], n_rx: int) -> np.ndarray:
    """Codes (tx and rx, chirp of each, sample) as (chirp, rx, sample) in the order sent."""
    by_transmitter = codes.reshape(len(turns), n_rx, *codes.shape[1:])
    return by_transmitter[list(turns)].transpose(2, 0, 1, 3).reshape(-1, n_rx, codes.shape[-1])


def _to_full_scale(file: Path, codes: np.ndarray, index: int, out: np.ndarray) -> None:
    """Fill (chirp, rx, sample) within -1 to 1 with codes in that order."""
    low, high = int(codes.min()), int(codes.max())
    if low < 0 or high > _LARGEST_CODE:
        raise RecordingError(
            file,
            got=f"codes from {low} to {high} in frame {index}",
            need=f"codes from 0 to {_LARGEST_CODE}, of a 12-bit converter",
            fix="Copy the recording again from its source.",
        )
    out[:] = codes
    out *= np.float32(2)
    out -= np.float32(_LARGEST_CODE)
    out *= np.float32(_SCALE)
