"""What a call of `run` asks for, as a scenario."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dechirp.cli.wrong import under_option
from dechirp.config import files
from dechirp.config.models import Readers
from dechirp.config.shown import shown
from dechirp.config.texts import dump
from dechirp.core.errors import DechirpError, InvalidFile, Mistake
from dechirp.experiment.scenario import READERS, Scenario, Source, load, reference
from dechirp.formats.recording import open as open_recording
from dechirp.formats.settings.calibration import read_calibration
from dechirp.formats.settings.read import read_radar
from dechirp.live.udp import is_address
from dechirp.radar.devices.known import device as known_device
from dechirp.radar.radar import Radar

_OPTIONS = {
    "Scenario.n_frames": "--frames",
    "Source.frames": "--frames",
}


def scenario_of(
    source: Path | None,
    *,
    changes: Sequence[str],
    radar: Path | None,
    frames: str | None,
    seed: str | None,
    told: Mapping[str, Any],
) -> Scenario:
    """Scenario of a settings file or of a recording; without either, the reference scenario.

    Parameters
    ----------
    source : Path, optional
        A scenario by its ending, `.yaml` or `.yml`; else a recording.
    changes : sequence of str
        PATH=VALUE, as after `--set`.
    radar, frames, seed
        As after the options of these names.
    told : mapping
        What was said of a recording: `device`, `format`, `axes`, `encoding`, `iq`, `calibration`.

    Raises
    ------
    DechirpError
        With what is wrong in the files or the options.
    """
    options = _OPTIONS
    if seed is not None:
        changes, options = [*changes, f"seed={seed}"], {**options, "seed": "--seed"}
    try:
        made = _made(source, changes, radar, told)
        recording = made.recording
        if recording is None:
            return _simulated(made, frames, told)
        if frames is not None:
            told = {**told, "frames": frames_of(frames)}
        if "calibration" in told:
            told = {**told, "calibration": read_calibration(told["calibration"])}
        if radar is not None and not _of_radar(changes):
            # A vendor's file also says how the samples lie, which the radar alone does not.
            made, told = replace(made, radar=None), {**told, "settings_path": str(radar.absolute())}
        return replace(made, recording=replace(recording, **told))
    except DechirpError as error:
        raise under_option(error, options) from None


def _made(
    source: Path | None, changes: Sequence[str], radar: Path | None, told: Mapping[str, Any]
) -> Scenario:
    """Scenario with the changes, made to the radar of the file where there is one."""
    if radar is not None:
        changes = [f"radar={_quoted(radar)}", *changes]
    if source is None:
        return reference(changes)
    if source.suffix.lower() in (".yaml", ".yml"):
        return load(source, changes)
    if is_address(str(source)):
        return _heard(source, changes, radar)
    path, iq, own, layout = source.absolute(), None, None, None
    chip = known_device(told["device"]) if "device" in told else None
    if _of_radar(changes):
        # There must be a radar to change. Its file also knows how the samples lie.
        opened = open_recording(source, **{"radar": radar, **told})
        iq, own = opened.contents.iq, opened.radar
        if opened.contents.settings_path is not None:
            layout = str(opened.contents.settings_path.absolute())
        if radar is None:
            changes = [f"radar={_quoted(path)}", *changes]

    def radar_of(file: Path) -> Radar:
        return own if own is not None and file == path else read_radar(file, chip)

    made = Scenario(name=source.stem, recording=Source(path=str(path), iq=iq, settings_path=layout))
    return _changed(made, changes, {**READERS, Radar: radar_of}) if changes else made


def spelled(source: Path) -> str:
    """Write a source as it was given: as a path, an address has lost a slash."""
    return re.sub(r"^udp:[/\\]+", "udp://", str(source), flags=re.IGNORECASE)


def _heard(source: Path, changes: Sequence[str], radar: Path | None) -> Scenario:
    """Scenario of what is sent to a UDP address."""
    layout = None if radar is None else str(radar.absolute())
    made = Scenario(name="live", recording=Source(path=spelled(source), settings_path=layout))
    return _changed(made, changes, READERS) if changes else made


def _quoted(path: Path) -> str:
    return json.dumps(str(path.absolute()), ensure_ascii=False)


def _changed(made: Scenario, changes: Sequence[str], readers: Readers) -> Scenario:
    text = dump(made)
    try:
        return files.parse(text, Scenario, file="", overrides=changes, readers=readers)
    except InvalidFile as error:
        # Nobody can look into a file that is not there.
        raise InvalidFile(
            *(
                m if m.file else replace(m, file=None, line=None, column=None)
                for m in error.mistakes
            )
        ) from None


def _of_radar(changes: Sequence[str]) -> bool:
    return any(change.lstrip().startswith("radar.") for change in changes)


def _simulated(made: Scenario, frames: str | None, told: Mapping[str, Any]) -> Scenario:
    """Scenario of a scene, with so many frames; what is said of a recording has no place."""
    mistakes = [
        Mistake(
            setting=f"--{name}",
            got="given for a scene that is simulated",
            need="left out: it is for recordings",
            fix="Leave it out, or name the recording.",
        )
        for name in told
    ]
    if mistakes:
        raise InvalidFile(*mistakes)
    if frames is None:
        return made
    first, stop = frames_of(frames)
    if first:
        raise _wrong_frames(frames, need="a number of frames, to simulate so many")
    return replace(made, n_frames=stop)


def frames_of(text: str) -> tuple[int, int]:
    """First frame, and the one after the last, of `N` or `A:B`."""
    match = re.fullmatch(r"(?:(\d{1,9}):)?(\d{1,9})", text.strip(), re.ASCII)
    if match is None:
        raise _wrong_frames(text, need="a number of frames, as 10, or a part, as 20:30")
    return int(match[1] or 0), int(match[2])


def _wrong_frames(text: str, *, need: str) -> InvalidFile:
    return InvalidFile(
        Mistake(
            setting="--frames",
            got=shown(text),
            need=need,
            fix="Frames are counted from 0; 20:30 stops before frame 30.",
        )
    )
