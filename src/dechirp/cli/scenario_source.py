"""Scenario of a call of `run`, from its source and options."""

import json
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dechirp.cli.errors import replace_settings_by_options
from dechirp.config import loading
from dechirp.config.dumping import dump_yaml
from dechirp.config.validation import Readers
from dechirp.core.errors import (
    DechirpError,
    InvalidFile,
    Mistake,
    RecordingError,
    quote_for_message,
)
from dechirp.core.text import join_names
from dechirp.experiments.scenario import (
    READERS,
    RecordingSource,
    Scenario,
    keep_given_chain_settings,
    load,
    reference,
    traffic_scenario,
)
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device as known_device
from dechirp.radar.radar import Radar
from dechirp.recordings.live.udp import is_udp_address
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.recognise import find_recording_in_folder
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings.calibration import read_calibration
from dechirp.recordings.settings.read import find_settings_file, read_radar
from dechirp.traffic.source import TrafficSource
from dechirp.traffic.traffic import recognise_traffic

_FIXES_OF_SIMULATION_SETTINGS = {
    "seed": "remove it; only the noise of a simulation has a seed",
    "engine": "remove it; only a simulation has an engine",
    "n_frames": "select frames with --frames, such as --frames 10 or --frames 20:30",
    "impairments": "remove it; the samples already contain those of the radar",
}
_OPTIONS = {
    "Scenario.n_frames": "--frames",
    "RecordingSource.frames": "--frames",
}


def build_scenario(
    source: Path | None,
    *,
    changes: Sequence[str],
    radar: Path | None,
    frames: str | None,
    seed: str | None,
    metadata: Mapping[str, Any],
    traffic: Mapping[str, str] | None = None,
    mounts: Sequence[str] = (),
) -> Scenario:
    """Build the scenario of a settings file, recording or traffic file.

    The reference scenario by default.

    Parameters
    ----------
    source : Path, optional
        A scenario if its suffix is `.yaml` or `.yml`; else traffic if a format recognises it; else
        a recording.
    changes : sequence of str
        PATH=VALUE, the values of `--set`.
    radar, frames, seed
        Values of the options of these names.
    metadata : mapping
        Options for a recording: `device`, `format`, `axes`, `encoding`, `iq`, `calibration`.
    traffic : mapping, optional
        Options for traffic: `ego`.
    mounts : sequence of str
        Places of the radar in traffic; of several radars if there is more than one.

    Raises
    ------
    DechirpError
        If a file or an option is invalid.
    """
    options = _OPTIONS
    if len(mounts) > 1:
        radars = ", ".join(f"{{mount: {json.dumps(mount)}}}" for mount in mounts)
        changes = [*changes, f"radars=[{radars}]"]
        options = {**options, **{f"radars.{n}.mount": "--mount" for n in range(len(mounts))}}
        options |= {f"radars.{n}.name": "--mount" for n in range(len(mounts))}
    elif mounts:
        traffic = {**(traffic or {}), "mount": mounts[0]}
    for name, value in (traffic or {}).items():
        changes = [*changes, f"traffic.{name}={value}"]
        options = {**options, f"traffic.{name}": f"--{name}"}
    if seed is not None:
        changes = [*changes, f"seed={seed}"]
        options = {**options, "seed": "--seed", "--set seed": "--seed"}
    try:
        scenario = _load_scenario_from_source(source, changes, radar, metadata)
        recording = scenario.recording
        if scenario.traffic is not None:
            return _set_traffic_frames(scenario, scenario.traffic, frames, metadata)
        if recording is None:
            return _set_simulated_frame_count(scenario, frames, metadata)
        _check_changes_affect_recording(changes)
        if frames is not None:
            metadata = {**metadata, "frames": parse_frame_range(frames)}
        if "calibration" in metadata:
            metadata = {**metadata, "calibration": read_calibration(metadata["calibration"])}
        if radar is not None and not _has_radar_changes(changes):
            # A vendor's file also describes the sample layout, which the radar does not contain.
            scenario, metadata = (
                replace(scenario, radar=None),
                {**metadata, "settings_path": str(radar.absolute())},
            )
        return replace(scenario, recording=replace(recording, **metadata))
    except DechirpError as error:
        raise replace_settings_by_options(error, options) from None


def _load_scenario_from_source(
    source: Path | None, changes: Sequence[str], radar: Path | None, metadata: Mapping[str, Any]
) -> Scenario:
    """Load the source with the changes applied to the radar of its file, if any."""
    if radar is not None:
        changes = [f"radar={_path_as_yaml_string(radar)}", *changes]
    if source is None:
        return reference(changes)
    if source.suffix.lower() in (".yaml", ".yml"):
        return load(source, changes)
    traffic_file = _find_traffic_file(source)
    if traffic_file is not None:
        return traffic_scenario(traffic_file, changes)
    if is_udp_address(str(source)):
        return _udp_address_scenario(source, changes, radar)
    is_of_traffic = any(change.lstrip().startswith("traffic.") for change in changes)
    has_radars = any(change.lstrip().startswith("radars") for change in changes)
    if is_of_traffic or (has_radars and not _is_existing(source)):
        return traffic_scenario(source, changes)  # its reader states what the source is
    path, iq, opened_radar, layout = source.absolute(), None, None, None
    chip = known_device(metadata["device"]) if "device" in metadata else None
    if _has_radar_changes(changes):
        iq, opened_radar, settings_path = _open_unchanged_recording(source, radar, chip, metadata)
        if settings_path is not None:
            layout = str(settings_path.absolute())
        if radar is None:
            changes = [f"radar={_path_as_yaml_string(path)}", *changes]

    def read_radar_file(file: Path) -> Radar:
        return opened_radar if opened_radar is not None and file == path else read_radar(file, chip)

    scenario = Scenario(
        name=source.stem, recording=RecordingSource(path=str(path), iq=iq, settings_path=layout)
    )
    return (
        _apply_setting_changes(scenario, changes, {**READERS, Radar: read_radar_file})
        if changes
        else scenario
    )


def _is_existing(source: Path) -> bool:
    """Return whether a file or folder exists; False for a name that the system refuses."""
    try:
        return source.exists()
    except OSError:
        return False


def _find_traffic_file(source: Path) -> Path | None:
    """Return the traffic file of a source: itself, or that of a folder without recordings.

    Raises
    ------
    RecordingError
        If a folder without recordings contains several traffic files.
    """
    try:
        if not source.is_dir():
            return source if recognise_traffic(source) is not None else None
        files = [file for file in sorted(source.iterdir()) if recognise_traffic(file) is not None]
    except OSError:  # `open` reports the reason
        return None
    if not files or _contains_recording(source):
        return None
    if len(files) > 1:
        raise RecordingError(
            source,
            value=f"a folder with {len(files)} traffic files:"
            f" {join_names(file.name for file in files)}",
            expected="one traffic file",
            fix=f"give one of them: dechirp run {shlex.quote(str(files[0]))}",
        )
    return files[0]


def _contains_recording(folder: Path) -> bool:
    try:
        find_recording_in_folder(folder, None, RecordingHints())
    except DechirpError:
        return False
    return True


def _open_unchanged_recording(
    source: Path, radar: Path | None, chip: Device | None, metadata: Mapping[str, Any]
) -> tuple[Iq | None, Radar, Path | None]:
    """Return I/Q order, radar and settings file of a recording, from which changes start.

    Settings that fit the recording only after the changes are read without the recording.
    """
    try:
        recording = open_recording(source, **{"radar": radar, **metadata})
    except DechirpError as error:
        try:
            settings_path = radar or find_settings_file(source)
        except DechirpError:
            raise error from None
        return None, read_radar(settings_path, chip), settings_path
    contents = recording.contents
    return contents.iq, recording.radar, contents.settings_path


def format_source_as_typed(source: Path) -> str:
    """Return a source as the user wrote it; a path has lost one slash of an address."""
    return re.sub(r"^udp:[/\\]+", "udp://", str(source), flags=re.IGNORECASE)


def _udp_address_scenario(source: Path, changes: Sequence[str], radar: Path | None) -> Scenario:
    """Return the scenario of a UDP address."""
    layout = None if radar is None else str(radar.absolute())
    scenario = Scenario(
        name="live",
        recording=RecordingSource(path=format_source_as_typed(source), settings_path=layout),
    )
    return _apply_setting_changes(scenario, changes, READERS) if changes else scenario


def _path_as_yaml_string(path: Path) -> str:
    return json.dumps(str(path.absolute()), ensure_ascii=False)


def _apply_setting_changes(
    scenario: Scenario, changes: Sequence[str], readers: Readers
) -> Scenario:
    text = dump_yaml(scenario)
    try:
        changed = loading.parse_settings(
            text, Scenario, file="", overrides=changes, readers=readers
        )
        return keep_given_chain_settings(changed, changes)
    except InvalidFile as error:
        # Places in generated text have no meaning to the user.
        raise InvalidFile(
            *(
                m if m.file else replace(m, file=None, line=None, column=None)
                for m in error.mistakes
            )
        ) from None


def _has_radar_changes(changes: Sequence[str]) -> bool:
    return any(change.lstrip().startswith("radar.") for change in changes)


def _check_changes_affect_recording(changes: Sequence[str]) -> None:
    """Refuse changes of settings that only simulations use."""
    mistakes = [
        Mistake(
            setting=f"--set {name}",
            value="given for a recording",
            expected="settings of the recording, its radar or its processing",
            fix=_FIXES_OF_SIMULATION_SETTINGS[setting],
        )
        for change in changes
        if (setting := re.split(r"[.\[=]", name := change.partition("=")[0].strip())[0])
        in _FIXES_OF_SIMULATION_SETTINGS
    ]
    if mistakes:
        raise InvalidFile(*mistakes)


def _set_simulated_frame_count(
    scenario: Scenario, frames: str | None, recording_options: Mapping[str, Any]
) -> Scenario:
    """Set the number of simulated frames; refuse options that belong to recordings."""
    _refuse_recording_options(recording_options, "a simulated scene")
    if frames is None:
        return scenario
    first, stop = parse_frame_range(frames)
    if first:
        raise _invalid_frames_error(frames, expected="a number of frames to simulate")
    return replace(scenario, n_frames=stop)


def _set_traffic_frames(
    scenario: Scenario,
    traffic: TrafficSource,
    frames: str | None,
    recording_options: Mapping[str, Any],
) -> Scenario:
    """Set start and duration of the frames of traffic; refuse options of recordings."""
    _refuse_recording_options(recording_options, "traffic")
    if frames is None:
        return scenario
    first, stop = parse_frame_range(frames)
    radar = scenario.radars[0].radar if scenario.radars else None
    radar = radar or scenario.radar
    assert radar is not None
    if stop <= first:
        raise _invalid_frames_error(
            frames, expected="a first frame, and a later one to stop before"
        )
    frame = radar.frame
    start_s = frame.frame_start_s(first)
    end_s = frame.frame_start_s(stop - 1) + frame.for_frame(stop - 1).duration_s
    selected = replace(traffic, start_s=traffic.start_s + start_s, duration_s=end_s - start_s)
    return replace(scenario, traffic=selected)


def _refuse_recording_options(names: Iterable[str], given_for: str) -> None:
    mistakes = [
        Mistake(
            setting=f"--{name}",
            value=f"given for {given_for}",
            expected="a recording",
            fix="remove it, or name the recording",
        )
        for name in names
    ]
    if mistakes:
        raise InvalidFile(*mistakes)


def parse_frame_range(text: str) -> tuple[int, int]:
    """Parse `N` or `A:B` to the first frame and the one after the last."""
    match = re.fullmatch(r"(?:(\d{1,9}):)?(\d{1,9})", text.strip(), re.ASCII)
    if match is None:
        raise _invalid_frames_error(
            text, expected="a number of frames, such as 10, or a range, such as 20:30"
        )
    return int(match[1] or 0), int(match[2])


def _invalid_frames_error(text: str, *, expected: str) -> InvalidFile:
    return InvalidFile(
        Mistake(
            setting="--frames",
            value=quote_for_message(text),
            expected=expected,
            fix="count frames from 0; 20:30 excludes frame 30",
        )
    )
