"""Inspection of a recording: its format, its radar, its first map, and its defects."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.compiled_kernels import plain_twins_for_small_work
from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.processing.quality.findings import recording_findings
from dechirp.processing.quality.measures import QualityMeasurer
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device as known_device
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.recognise import (
    find_recording_in_folder,
    format_or_points,
    recognise_formats,
)
from dechirp.recordings.recording import (
    Recording,
    check_axes_and_frames,
    combine_radar_and_layout_settings,
    recording_path,
    split_axis_names,
)
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings.calibration import read_calibration

_FRAME_SETTINGS = ("radar.frame.n_chirps", "radar.frame.period")


@frozen_dataclass
class Inspection:
    """Contents and findings of a recording."""

    path: Path
    formats: tuple[str, ...]
    """Formats that match its content; a single one if that is certain."""
    recording: Recording | None
    """None if its format is known but it cannot be read yet; the findings list what is missing."""
    power: xr.DataArray | None
    """Map of the first frame, (velocity, range); None without samples."""
    findings: tuple[Finding, ...]


@check_argument_types
def inspect(
    path: str | Path,
    *,
    radar: Radar | str | Path | None = None,
    device: str | None = None,
    format: str | None = None,
    axes: Sequence[str] | str | None = None,
    encoding: str | None = None,
    iq: str | None = None,
    calibration: Calibration | str | Path | None = None,
    frames: tuple[int, int] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Inspection:
    """Inspect a recording frame by frame, holding one frame at a time.

    Parameters
    ----------
    path, radar, device, format, axes, encoding, iq, calibration, frames
        As in `open`. With a device, its rules are checked as well; those of whole
        frames only if the frame period is known.
    progress : callable, optional
        Called with the number of finished frames and of all frames.

    Raises
    ------
    RecordingError
        If the content matches no format, or given settings cannot be read. Missing settings of a
        known format are findings.
    InvalidFile
        If the given settings have mistakes.
    InvalidSetting
        If no device of that name is known, or the path is empty.
    """
    path = recording_path(path)
    options = {"axes": axes, "encoding": encoding, "iq": iq}
    # Mistakes in given names or files are errors, not findings on the recording.
    check_axes_and_frames(axes, frames)
    chip = None if device is None else known_device(device)
    hints = RecordingHints(
        settings=combine_radar_and_layout_settings(radar, None, chip),
        device=chip,
        axes=None if axes is None else split_axis_names(axes),
        encoding=encoding,
        iq=cast(Iq | None, iq),
    )
    file, _ = find_recording_in_folder(path, format, hints)
    kinds = recognise_formats(
        file,
        format_or_points(format, hints.axes),
        given_options=[name for name, option in options.items() if option is not None],
    )
    if isinstance(calibration, str | Path):
        calibration = read_calibration(calibration)
    try:
        recording = open_recording(
            path,
            radar=radar,
            device=device,
            format=format,
            axes=axes,
            encoding=encoding,
            iq=iq,
            calibration=calibration,
        )
    except DechirpError as error:
        return _inspection_of_unreadable_recording(path, kinds, error)
    if frames is not None:
        recording = recording.select_frames(*frames)
    power, findings = None, recording.findings
    try:
        if recording.sizes:
            with plain_twins_for_small_work(math.prod(recording.sizes.values())):
                power, findings = _first_frame_map_and_sample_findings(recording, progress)
    except DechirpError as error:
        return _inspection_of_unreadable_recording(path, kinds, error)
    if chip is not None and recording.contents.radar is not None:
        findings += _broken_device_rules(chip, recording.radar)
    return Inspection(
        path=path, formats=(recording.format,), recording=recording, power=power, findings=findings
    )


def _first_frame_map_and_sample_findings(
    recording: Recording, progress: Callable[[int, int], None] | None
) -> tuple[xr.DataArray, tuple[Finding, ...]]:
    """Compute the map of the first frame, and findings on the samples of all frames."""
    from dechirp.processing.chain import Chain
    from dechirp.processing.range_doppler_map import power_map

    first = next(recording.frames())
    power = power_map(first, recording.radar, Chain())
    measurer = QualityMeasurer(recording.radar, n_frames=recording.n_frames)
    for number, samples, is_lost in recording.iter_frame_samples():
        measurer.add_frame(samples, is_lost, recording.radar.frame.frame_start_s(number))
        if progress is not None:
            progress(measurer.n_frames, recording.n_frames)
    measures = measurer.joined_measures(recording.contents.units)
    findings = recording.findings
    return power, findings + find_sample_findings(measures, recording.radar, findings)


def find_sample_findings(
    measures: xr.Dataset, radar: Radar, reader_findings: tuple[Finding, ...]
) -> tuple[Finding, ...]:
    """Return the findings on measured samples that the reader of a recording has not reported."""
    findings = recording_findings(measures, radar)
    warned_settings = {f.setting for f in reader_findings if f.level == "warning"}
    if "iq" in warned_settings:  # the reader has checked the sign of beat frequencies
        return tuple(finding for finding in findings if finding.setting != "recording.iq")
    return findings


def _broken_device_rules(chip: Device, radar: Radar) -> tuple[Finding, ...]:
    """Return the rules of a chip that the radar of a recording breaks."""
    broken = chip.find_broken_rules(radar, demo=False)
    if radar.frame.period_s is not None:
        return broken
    # Without a frame period, the chirps may have been frames of one chirp.
    return tuple(rule for rule in broken if rule.setting not in _FRAME_SETTINGS)


def _inspection_of_unreadable_recording(
    path: Path, formats: tuple[str, ...], error: DechirpError
) -> Inspection:
    """Return an inspection that lists what is missing to read the recording."""
    missing = tuple(Finding.from_mistake(mistake, level="error") for mistake in error.mistakes)
    return Inspection(path=path, formats=formats, recording=None, power=None, findings=missing)
