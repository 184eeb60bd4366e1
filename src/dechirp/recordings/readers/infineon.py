"""Infineon recordings (ifxdaq, Radar Fusion GUI): a folder with `radar.npy` and `config.json`.

12-bit ADC codes (frame, rx, chirp, sample) of the real beat signal. The ADC offset, about 0.4 of
full scale, is part of the samples and stays. With two time-multiplexed transmitters, either all
chirps lie in the order sent, or the axis `rx` holds the receivers of each transmitter; the sizes
distinguish the two (not verified on a real recording with two transmitters).
"""

from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    check_stays_in_folder,
)
from dechirp.recordings.readers.npy import open_npy_array
from dechirp.recordings.settings.antenna_positions import fit_array_to_receiver_count
from dechirp.recordings.settings.read import read_settings

_MAX_CODE = 4095
_SCALE = 1 / _MAX_CODE  # half an ADC step: codes lie between whole steps
_SAMPLES, _CONFIG = "radar.npy", "config.json"


@frozen_dataclass
class Infineon(Format):
    """Infineon recordings (ifxdaq, Radar Fusion GUI): `radar.npy` with `config.json`.

    The folder itself, a folder that contains only it, or its `radar.npy`.
    """

    def recognise(self, path: Path) -> MatchQuality:
        return MatchQuality.SELF_DESCRIBING if _find_recording_folders(path) else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        folders = _find_recording_folders(path)
        if len(folders) != 1:
            names = ", ".join(folder.name for folder in folders) or "none"
            raise RecordingError(
                path,
                value=f"a folder with {len(folders)} recordings ({names})",
                expected="one recording",
                fix="give the folder of one recording",
            )
        settings = hints.settings or read_settings(folders[0] / _CONFIG, hints.device)
        file = folders[0] / _SAMPLES
        check_stays_in_folder(folders[0], file)
        codes = open_npy_array(file)
        frame, n_rx = settings.radar.frame, settings.radar.array.n_rx
        expected_n_rx = codes.shape[1] if len(codes.shape) == 4 and n_rx == 1 else n_rx
        expected_shape = (expected_n_rx, frame.n_chirps_total, frame.chirp.n_samples)
        # Chirps of time-multiplexed transmitters may be sorted already, a row per (tx, rx) pair.
        turns = frame.tdm_order or ()
        is_sorted = len(turns) > 1 and codes.shape[1:] == (
            len(turns) * n_rx,
            frame.n_chirps,
            frame.chirp.n_samples,
        )
        if codes.dtype.kind not in "iu" or not (codes.shape[1:] == expected_shape or is_sorted):
            raise RecordingError(
                file,
                value=f"an array of {codes.dtype} of shape {codes.shape}",
                expected="integers of shape (frames, rx, chirp, sample) = (frames,"
                f" {', '.join(str(size) for size in expected_shape)}) from the settings",
                fix="give the settings of the recording",
            )
        if frame.chirp.sampling != "real":
            raise RecordingError(
                file,
                value="real samples, but radar.frame.chirp.sampling is complex",
                expected="sampling: real",
                fix="set sampling: real",
            )
        n_present = n_rx if is_sorted else codes.shape[1]
        radar, findings = fit_array_to_receiver_count(settings.radar, n_present, file=file)

        def decode(index: int, out: np.ndarray) -> None:
            slices = (slice(0, size) for size in codes.shape[1:])
            frame_codes = codes.read((slice(index, index + 1), *slices))[0]
            ordered_codes = (
                _reorder_to_sent_chirps(frame_codes, turns, n_rx)
                if is_sorted
                else np.swapaxes(frame_codes, 0, 1)
            )
            _scale_codes_to_full_scale(file, ordered_codes, index, out)

        return Contents(
            radar=radar,
            n_frames=codes.shape[0],
            decode=decode,
            scale=_SCALE,
            findings=settings.findings + findings,
        )


def _find_recording_folders(path: Path) -> list[Path]:
    """Return the recording folders that a path can refer to."""
    if path.is_file():
        has_both_files = path.name == _SAMPLES and (path.parent / _CONFIG).is_file()
        return [path.parent] if has_both_files else []
    if (path / _SAMPLES).is_file():
        return [path]
    return sorted(file.parent for file in path.glob(f"*/{_SAMPLES}"))


def _reorder_to_sent_chirps(codes: np.ndarray, tx_order: tuple[int, ...], n_rx: int) -> np.ndarray:
    """Reorder codes (tx and rx, chirp of each tx, sample) to (chirp, rx, sample) as sent."""
    by_transmitter = codes.reshape(len(tx_order), n_rx, *codes.shape[1:])
    return by_transmitter[list(tx_order)].transpose(2, 0, 1, 3).reshape(-1, n_rx, codes.shape[-1])


def _scale_codes_to_full_scale(
    file: Path, codes: np.ndarray, frame_index: int, out: np.ndarray
) -> None:
    """Fill `out` (chirp, rx, sample) with the codes scaled to -1 ... 1."""
    low, high = int(codes.min()), int(codes.max())
    if low < 0 or high > _MAX_CODE:
        raise RecordingError(
            file,
            value=f"codes from {low} to {high} in frame {frame_index}",
            expected=f"codes of a 12-bit ADC, 0 to {_MAX_CODE}",
            fix="copy the recording again from its source",
        )
    out[:] = codes
    out *= np.float32(2)
    out -= np.float32(_MAX_CODE)
    out *= np.float32(_SCALE)
