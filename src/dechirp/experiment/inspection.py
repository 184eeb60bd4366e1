"""A recording looked over: what it is, what its radar can see, and what is wrong with it."""

from collections.abc import Callable, Sequence
from pathlib import Path

import xarray as xr

from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.recognise import recognised
from dechirp.formats.recording import Recording
from dechirp.formats.recording import open as open_recording
from dechirp.formats.settings.calibration import read_calibration
from dechirp.formats.settings.read import read_radar
from dechirp.process.chain import Chain
from dechirp.process.health.findings import findings as judged
from dechirp.process.health.measures import measure
from dechirp.process.maps import power_map
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.known import device as known_device
from dechirp.radar.radar import Radar

_OF_FRAMES = ("radar.frame.n_chirps", "radar.frame.period")


@value
class Inspection:
    """What was found in a recording."""

    path: Path
    formats: tuple[str, ...]
    """Kinds that fit its content; one, where that is certain."""
    recording: Recording | None
    """None where it is known but cannot be read yet; the findings say what is missing."""
    power: xr.DataArray | None
    """Map of the first frame, (velocity, range); None without samples."""
    findings: tuple[Finding, ...]


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
    """Look a recording over, frame by frame, so that one is held at a time.

    Parameters
    ----------
    path, radar, device, format, axes, encoding, iq, calibration, frames
        As `open` takes them. With a device, its rules are checked as well; those of whole
        frames only where the period of the frames is known.
    progress : callable, optional
        Called with the number of frames done and of all frames.

    Raises
    ------
    RecordingError
        If the content fits no format, or the settings that are given cannot be read. What is
        missing to read a recording of a known format is a finding.
    InvalidFile
        If the settings that are given have mistakes.
    InvalidSetting
        If no device of that name is known.
    """
    path = Path(path)
    said = {"axes": axes, "encoding": encoding, "iq": iq}
    kinds = recognised(path, format, given=[name for name, one in said.items() if one is not None])
    # What is wrong with a name or a file that was told is no finding of the recording.
    chip = None if device is None else known_device(device)
    if isinstance(radar, str | Path):
        read_radar(radar, chip)
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
        return _unread(path, kinds, error)
    if frames is not None:
        recording = recording.part(*frames)
    power, found = None, recording.findings
    try:
        if recording.sizes:
            power, found = _samples(recording, progress)
    except DechirpError as error:
        return _unread(path, kinds, error)
    if chip is not None and recording.contents.radar is not None:
        found += _broken_rules(chip, recording.radar)
    return Inspection(
        path=path, formats=(recording.format,), recording=recording, power=power, findings=found
    )


def _samples(
    recording: Recording, progress: Callable[[int, int], None] | None
) -> tuple[xr.DataArray, tuple[Finding, ...]]:
    """Map of the first frame, and what the samples of all of them say."""
    power, measures = None, []
    for frame in recording.frames():
        if power is None:
            power = power_map(frame.isel(frame=0), recording.radar, Chain())
        measures.append(measure(frame, recording.radar))
        if progress is not None:
            progress(len(measures), recording.n_frames)
    assert power is not None  # a recording has a frame
    seen = judged(xr.concat(measures, "frame"), recording.radar)
    said = [finding.setting for finding in recording.findings if finding.level == "warning"]
    if "iq" in said:  # opening it has seen the side on which echoes lie
        seen = tuple(finding for finding in seen if finding.setting != "recording.iq")
    return power, recording.findings + seen


def _broken_rules(chip: Device, radar: Radar) -> tuple[Finding, ...]:
    """Rules of a chip that the radar of a recording breaks."""
    broken = chip.broken_rules(radar, demo=False)
    if radar.frame.period_s is not None:
        return broken
    # Nobody said in which frames the chirps came: they may have been frames of one chirp.
    return tuple(rule for rule in broken if rule.setting not in _OF_FRAMES)


def _unread(path: Path, kinds: tuple[str, ...], error: DechirpError) -> Inspection:
    """Say what is missing to read a recording that is known."""
    missing = tuple(Finding.of(mistake, level="error") for mistake in error.mistakes)
    return Inspection(path=path, formats=kinds, recording=None, power=None, findings=missing)
