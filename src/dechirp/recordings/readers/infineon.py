"""Infineon recordings (ifxdaq, Radar Fusion GUI): a folder with `radar.npy` and `config.json`.

12-bit ADC codes (frame, rx, chirp, sample) of the real beat signal. The ADC offset, about 0.4 of
full scale, is part of the samples and stays. Frames of the vendor's Python library are floats of
full scale 1. With two time-multiplexed transmitters, either all chirps lie in the order sent, or
the axis `rx` holds the receivers of each transmitter; the sizes distinguish the two (not verified
on a real recording with two transmitters).

`radar_timestamp.csv`, where present, holds the computer's time of each frame, and replaces the
times that follow from the frame period.
"""

from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import format_si
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
_SAMPLES, _CONFIG, _TIMES = "radar.npy", "config.json", "radar_timestamp.csv"
_MAX_TIME_BYTES = 2**26  # 3 million frames
_TIME_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)


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
        if hints.settings is None and not (folders[0] / _CONFIG).is_file():
            raise RecordingError(
                folders[0] / _CONFIG,
                value=f"not readable (no such file): {_SAMPLES} without {_CONFIG}, the settings of"
                " the radar",
                expected="both files in the folder",
                fix=f"copy {_CONFIG} of this recording into {folders[0].name}, or give the radar:"
                " --radar FILE",
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
        if codes.dtype.kind not in "iuf" or not (codes.shape[1:] == expected_shape or is_sorted):
            raise RecordingError(
                file,
                value=f"an array of {codes.dtype} of shape {codes.shape}",
                expected="integers or floats of shape (frames, rx, chirp, sample) = (frames,"
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
            if codes.dtype.kind == "f":
                _copy_normalised_numbers(file, ordered_codes, index, out)
            else:
                _scale_codes_to_full_scale(file, ordered_codes, index, out)

        starts_s, time_findings = _read_frame_starts_and_findings(
            folders[0], codes.shape[0], radar.frame.frame_start_s(1)
        )
        return Contents(
            radar=radar,
            n_frames=codes.shape[0],
            decode=decode,
            scale=None if codes.dtype.kind == "f" else _SCALE,
            frame_starts_s=starts_s,
            findings=(*settings.findings, *findings, *time_findings),
        )


def _find_recording_folders(path: Path) -> list[Path]:
    """Return the recording folders that a path can refer to."""
    if path.is_file():
        has_both_files = path.name == _SAMPLES and (path.parent / _CONFIG).is_file()
        return [path.parent] if has_both_files else []
    if (path / _SAMPLES).is_file():
        return [path]
    return sorted(file.parent for file in path.glob(f"*/{_SAMPLES}"))


def _read_frame_starts_and_findings(
    folder: Path, n_frames: int, period_s: float
) -> tuple[np.ndarray | None, tuple[Finding, ...]]:
    """Return the start of each frame from that of the first, None without time stamps."""
    file = folder / _TIMES
    if not file.is_file():
        return None, ()
    check_stays_in_folder(folder, file)
    times, problem = _parse_times(file)
    steps = np.diff(times)
    if not problem and len(times) != n_frames:
        problem = f"{len(times)} time stamps for {n_frames} frames"
    elif not problem and not (steps > 0).all():
        problem = f"time stamps that do not increase at frame {int(np.argmin(steps > 0)) + 1}"
    # The period is known, so the unit is the one in which it comes out within a factor of 3.
    step = float(np.median(steps)) if len(steps) else period_s
    unit_s = next((unit for unit in _TIME_UNITS_S if 1 / 3 < step * unit / period_s < 3), None)
    if not problem and unit_s is None:
        problem = f"time stamps {format_si(step, 's', 4)} apart in the median"
    if problem or unit_s is None:
        return None, (
            Finding(
                level="warning",
                setting=_TIMES,
                value=f"{problem}; frames are timed by their period",
                expected=f"an increasing time in seconds for each frame, about"
                f" {format_si(period_s, 's')}"
                " apart",
                fix="copy the file again from its source if frame times matter",
            ),
        )
    starts_s = (times - times[0]) * unit_s
    return starts_s, _frame_time_findings(starts_s, period_s)


def _parse_times(file: Path) -> tuple[np.ndarray, str]:
    """Return the first column of a file of time stamps, and the problem if there is one."""
    with file.open("rb") as stream:
        content = stream.read(_MAX_TIME_BYTES + 1)
    if len(content) > _MAX_TIME_BYTES:
        return np.empty(0), f"more than {_MAX_TIME_BYTES} bytes"
    rows = [line.replace(b";", b",").split(b",")[0].strip() for line in content.splitlines()]
    rows = [row for row in rows if row]
    if rows and not rows[0][:1].isdigit():
        rows = rows[1:]  # name of the column
    try:
        times = np.array(rows, "S32").astype(float)
    except ValueError:
        return np.empty(0), "text that is no column of times"
    return (times, "") if np.isfinite(times).all() else (times, "times that are not finite")


def _frame_time_findings(starts_s: np.ndarray, period_s: float) -> tuple[Finding, ...]:
    """Report frame times that were taken from time stamps, and frames missing among them."""
    steps_s = np.diff(starts_s)
    n_missing = int(np.maximum(np.rint(steps_s / period_s) - 1, 0).sum())
    deviation_s = float(np.max(abs(starts_s - period_s * np.arange(len(starts_s)))))
    mean_s = float(np.mean(steps_s)) if len(steps_s) else period_s
    findings = [
        Finding(
            level="note",
            setting=_TIMES,
            value=f"frames are timed by it: {format_si(mean_s, 's')} apart on average, and up to"
            f" {format_si(deviation_s, 's', 3)} off the times of radar.frame.period"
            f" {format_si(period_s, 's')}",
            expected="the times at which frames were recorded; the computer adds a few ms",
            fix="no action needed",
        )
    ]
    if n_missing:
        longest = int(np.argmax(steps_s))
        findings.append(
            Finding(
                level="warning",
                setting=_TIMES,
                value=f"{n_missing} frames missing by the time stamps; the longest pause,"
                f" {format_si(steps_s[longest], 's', 4)}, follows frame {longest}",
                expected=f"a frame every {format_si(period_s, 's')}",
                fix="no action needed: frames keep their measured times",
            )
        )
    return tuple(findings)


def _reorder_to_sent_chirps(codes: np.ndarray, tx_order: tuple[int, ...], n_rx: int) -> np.ndarray:
    """Reorder codes (tx and rx, chirp of each tx, sample) to (chirp, rx, sample) as sent."""
    by_transmitter = codes.reshape(len(tx_order), n_rx, *codes.shape[1:])
    return by_transmitter[list(tx_order)].transpose(2, 0, 1, 3).reshape(-1, n_rx, codes.shape[-1])


def _copy_normalised_numbers(
    file: Path, numbers: np.ndarray, frame_index: int, out: np.ndarray
) -> None:
    """Fill `out` (chirp, rx, sample) with floats of full scale 1."""
    low, high = float(numbers.min()), float(numbers.max())
    if not -1 <= low <= high <= 1:
        raise RecordingError(
            file,
            value=f"numbers from {low:.6g} to {high:.6g} in frame {frame_index}",
            expected="floats of full scale 1, from -1 to 1, or integers of a 12-bit ADC",
            fix="save the frames as the radar's library returns them, or its codes as integers",
        )
    out[:] = numbers


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
