"""TI SDK 1 to 3: the commands that the demo was sent (`.cfg`).

Numbers are taken as they stand. The chip rounds them down to its own steps: the start by up
to 54 Hz, the slope by up to 48 kHz/us. So ranges come out too short by up to 0.07 % at
70 MHz/us, 7 mm at 10 m.

TI mmWave SDK User Guide, the section on the format of configuration files.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake, RecordingError
from dechirp.formats.settings.base import Settings, values_from
from dechirp.formats.settings.ti_cfg_lines import COMMANDS, Line, lines_of
from dechirp.formats.settings.ti_frame import BITS, MOST_CHIRPS, TiFrame, ti_settings, turns
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device

_NEWER = re.compile(r"^[ \t]*(chirpComnCfg|chirpTimingCfg)\b", re.MULTILINE)
_EITHER = re.compile(r"^[ \t]*(profileCfg|frameCfg|chirpComnCfg|chirpTimingCfg)\b", re.MULTILINE)
_PLATFORM = re.compile(r"^[ \t]*%[ \t]*Platform[ \t]*:[ \t]*([\w.-]{1,40})", re.MULTILINE)
_LARGEST = 2**18  # characters; real files have some 2000
_MOST_TOLD = 100  # mistakes: more are one, of taking the wrong file

_NEEDED = ("channelCfg", "adcCfg", "adcbufCfg", "profileCfg", "chirpCfg")
_FRAMES = ("frameCfg",)
_SUB_FRAMES = ("advFrameCfg", "subFrameCfg")

_READ = (
    ("dfeDataOutputMode", "mode", (1, 3), "1 or 3: frames, or sub-frames"),
    ("channelCfg", "rx_mask", range(1, 2**16), "a bit for each receiver, at least one"),
    ("channelCfg", "cascading", (0,), "0: a chip alone"),
    ("adcCfg", "bits", tuple(BITS), "0, 1 or 2: 12, 14 or 16 bits"),
    ("adcCfg", "format", (0, 1, 2), "0, 1 or 2: real, or complex"),
    ("adcbufCfg", "sample_swap", (0, 1), "0 or 1"),
    ("adcbufCfg", "interleave", (0, 1), "0 or 1"),
    ("bpmCfg", "enabled", (0, 1), "0 or 1: transmitters that take turns, or two together"),
    ("lvdsStreamCfg", "header", (0,), "0: samples without headers"),
    ("lvdsStreamCfg", "data_format", (0, 1), "0 or 1: samples alone"),
    ("lvdsStreamCfg", "software", (0,), "0: samples alone"),
    ("advFrameCfg", "n_sub_frames", (1,), "1: one sub-frame"),
    ("advFrameCfg", "force_profile", (0,), "0: the profiles of chirpCfg"),
    ("subFrameCfg", "sub_frame", (0,), "0: the first sub-frame"),
    ("subFrameCfg", "n_bursts", (1,), "1: one burst"),
    ("subFrameCfg", "n_burst_loops", (1,), "1: one burst"),
    ("chirpCfg", "start_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "slope_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "idle_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "adc_start_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "tx_mask", range(1, 2**16), "a bit for each transmitter, at least one"),
)
"""What is read, of all that the commands can say."""


def looks_like(text: str) -> bool:
    """Whether a text holds such commands."""
    return _EITHER.search(text) is not None


def read(file: Path, text: str, device: Device | None = None) -> Settings:
    """Read the settings that held when the sensor was started last.

    The last command of a kind holds. The device is the one that is given, else the one that
    a comment `% Platform:` names.

    Raises
    ------
    InvalidFile
        If commands are missing, wrong, or set up what is not read yet: all of them, each
        with its line.
    RecordingError
        If the numbers cannot be those of a radar.
    """
    if len(text) > _LARGEST:
        raise RecordingError(
            file,
            got=f"of {len(text)} characters",
            need=f"a list of commands, of at most {_LARGEST}",
            fix="Take the file as it was sent to the radar.",
        )
    newer = _NEWER.search(text)
    if newer:
        raise InvalidFile(_of_another_chip(file, text, newer))
    wrong: list[Mistake] = []
    lines = lines_of(file, text, wrong)
    last = {line.command: line for line in lines}
    mode = last.get("dfeDataOutputMode")
    frames = _SUB_FRAMES if mode and mode["mode"] == 3 else _FRAMES
    _must_be_there(file, (*_NEEDED, *frames), last, wrong)
    if wrong:
        raise InvalidFile(*wrong[:_MOST_TOLD])
    frame = last[frames[-1]]
    chirps = _chirps(file, lines, frame)
    _must_be_read(file, [*last.values()], chirps, frames)
    bpm = last.get("bpmCfg")
    if bpm is not None and not bpm["enabled"]:
        bpm = None
    profile = _profile(file, lines, chirps, frame, bpm)
    adc, buffer = last["adcCfg"], last["adcbufCfg"]
    platform = _PLATFORM.search(text)
    with values_from(file):
        sent = TiFrame(
            chirp=_chirp(profile, real=adc["format"] == 0),
            interval_s=(profile["idle_us"] + profile["ramp_end_us"]) / 1e6,
            masks=tuple(chirp.whole("tx_mask") for chirp in chirps),
            n_loops=frame.whole("n_loops"),
            n_frames=last[frames[0]].whole("n_frames"),
            period_s=frame["period_ms"] / 1e3,
            rx_mask=last["channelCfg"].whole("rx_mask"),
            bpm=bpm is not None,
        )
        return ti_settings(
            sent,
            iq="qi" if buffer["sample_swap"] else "iq",
            interleaved=not buffer["interleave"],
            bits=BITS[adc.whole("bits")],
            named=platform.group(1) if platform else "",
            device=device,
        )


def _of_another_chip(file: Path, text: str, found: re.Match[str]) -> Mistake:
    return Mistake(
        setting=found.group(1),
        got="a command of the low-power chips (xWRL)",
        need="absent: a file with profileCfg and chirpCfg, of SDK 1 to 3",
        fix="Give the radar as a YAML file; these files are not read yet.",
        file=str(file),
        line=len(text[: found.end()].splitlines()),
    )


def _must_be_there(
    file: Path, needed: Sequence[str], there: dict[str, Line], wrong: list[Mistake]
) -> None:
    """Note the commands that are missing; one that is there, but wrong, was named already."""
    named = {mistake.setting for mistake in wrong}
    wrong += [
        Mistake(
            setting=command,
            got="missing",
            need=f"given, before sensorStart, with {', '.join(COMMANDS[command])}",
            fix="Take the whole file, as it was sent to the radar.",
            file=str(file),
        )
        for command in needed
        if command not in there and command not in named
    ]


def _chirps(file: Path, lines: Sequence[Line], frame: Line) -> list[Line]:
    """Give the command behind each chirp of a loop, in the order sent."""
    first = frame.whole("first")
    last = frame.whole("last") if "last" in frame.numbers else first + frame.whole("n_chirps") - 1
    by_index = {
        index: line
        for line in lines
        if line.command == "chirpCfg"
        for index in range(max(line.whole("first"), 0), min(line.whole("last") + 1, MOST_CHIRPS))
    }
    missing = [n for n in range(max(first, 0), min(last + 1, MOST_CHIRPS)) if n not in by_index]
    if not 0 <= first <= last < MOST_CHIRPS or missing:
        got = f"of chirps {first} to {last}"
        raise InvalidFile(
            frame.mistake(
                file,
                got=got + (f", of which chirpCfg leaves out {missing[0]}" if missing else ""),
                need=f"of chirps within 0 to {MOST_CHIRPS - 1}, each with its chirpCfg",
                fix="Correct the range, or give the missing chirps.",
            )
        )
    return [by_index[index] for index in range(first, last + 1)]


def _must_be_read(
    file: Path, last: Sequence[Line], chirps: Sequence[Line], frames: Sequence[str]
) -> None:
    """Raise `InvalidFile` if the commands that hold set up what is not read."""
    idle = {"chirpCfg", *_FRAMES, *_SUB_FRAMES} - set(frames)  # chirps are looked at one by one
    held = [line for line in last if line.command not in idle]
    # Without any stream it does not matter how it would be written.
    held = [line for line in held if line.command != "lvdsStreamCfg" or line["data_format"]]
    held += _different(chirps)
    wrong = [
        line.mistake(
            file,
            got=f"given {name} {line[name]:g}",
            need=f"given {name} {need}",
            fix="Record it so; others are not read yet.",
        )
        for line in held
        for command, name, good, need in _READ
        if line.command == command and line[name] not in good
    ]
    adc, buffer = (line for line in last if line.command in ("adcCfg", "adcbufCfg"))
    if not wrong and buffer["format"] != (adc["format"] == 0):
        wrong = [
            buffer.mistake(
                file,
                got=f"given format {buffer['format']:g}, with format {adc['format']:g} in adcCfg",
                need="given format 0 for complex samples, 1 for real ones",
                fix="Correct one of the two.",
            )
        ]
    if wrong:
        raise InvalidFile(*sorted(wrong, key=lambda mistake: mistake.line or 0))


def _profile(
    file: Path, lines: Sequence[Line], chirps: Sequence[Line], frame: Line, bpm: Line | None
) -> Line:
    """Give the profile of all chirps, whose transmitters must take turns or be a pair of BPM."""
    profiles = {line["profile"]: line for line in lines if line.command == "profileCfg"}
    used = {chirp["profile"] for chirp in chirps}
    mistakes = [
        chirp.mistake(
            file,
            got=f"given profile {chirp['profile']:g}"
            + (", others of the frame another" if chirp["profile"] in profiles else ""),
            need="given one profile for all chirps, which profileCfg defines",
            fix="Record equal chirps; others are not read yet.",
        )
        for chirp in _different(chirps)
        if len(used) > 1 or chirp["profile"] not in profiles
    ]
    if bpm is None:
        mistakes += _not_in_turns(file, chirps, frame)
    else:
        mistakes += _no_pair(file, chirps, frame, bpm)
    if mistakes:
        raise InvalidFile(*mistakes)
    return profiles[used.pop()]


def _not_in_turns(file: Path, chirps: Sequence[Line], frame: Line) -> list[Mistake]:
    together = [
        chirp.mistake(
            file,
            got=f"given tx_mask {chirp['tx_mask']:g}",
            need="given tx_mask of one bit, one transmitter, unless bpmCfg says otherwise",
            fix="Record it so, or give the radar as a YAML file with its multiplexing.",
        )
        for chirp in _different(chirps)
        if chirp.whole("tx_mask").bit_count() != 1
    ]
    if together:
        return together
    try:
        turns([chirp.whole("tx_mask") for chirp in chirps])
    except InvalidSetting as error:
        (order,) = error.mistakes
        got = f"of chirps of transmitters {order.got}"
        return [frame.mistake(file, got=got, need=order.need, fix=order.fix)]
    return []


def _no_pair(file: Path, chirps: Sequence[Line], frame: Line, bpm: Line) -> list[Mistake]:
    """Say what is wrong with the two chirps that two transmitters send together.

    The demo gives the first no phase, the second 180 degrees on the later transmitter
    (SDK User Guide, bpmCfg).
    """
    masks = [chirp.whole("tx_mask") for chirp in chirps]
    both = (bpm["first"], bpm["second"]) == (frame["first"], frame["first"] + 1)
    if both and len(masks) == 2 and masks[0] == masks[1] and masks[0].bit_count() == 2:
        return []
    said = ", ".join(map(str, masks[:8])) + (" ..." if len(masks) > 8 else "")
    return [
        bpm.mistake(
            file,
            got=f"given enabled 1, for chirps {bpm['first']:g} and {bpm['second']:g}, in a frame"
            f" of chirps with tx_mask {said}",
            need="given the two chirps of the frame in the order sent, both with the same two"
            " transmitters, or enabled 0",
            fix="Record it so, or give the radar as a YAML file with its multiplexing.",
        )
    ]


def _different(chirps: Sequence[Line]) -> list[Line]:
    """Each command once, in the order of the chirps."""
    return [*{chirp.number: chirp for chirp in chirps}.values()]


def _chirp(profile: Line, *, real: bool) -> Chirp:
    return Chirp(
        start_frequency_hz=profile["start_ghz"] * 1e9,
        slope_hz_per_s=profile["slope_mhz_per_us"] * 1e12,
        adc_start_s=profile["adc_start_us"] / 1e6,
        ramp_duration_s=profile["ramp_end_us"] / 1e6,
        sample_rate_hz=profile["sample_rate_ksps"] * 1e3,
        n_samples=profile.whole("n_samples"),
        sampling="real" if real else "complex",
    )
