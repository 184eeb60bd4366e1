"""TI SDK 1 to 3: the commands sent to the demo (`.cfg`).

Numbers are read unchanged, although the chip rounds them down to its own steps: the start frequency
by up to 54 Hz, the slope by up to 48 kHz/us. So ranges are too short by up to 0.07 % at 70 MHz/us,
7 mm at 10 m.

TI mmWave SDK User Guide, section on the format of configuration files.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake, RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.recordings.settings.antenna_positions import (
    find_device_of_geometry,
    find_device_or_none,
)
from dechirp.recordings.settings.base import RecordingSettings, convert_setting_errors
from dechirp.recordings.settings.ti_board import choose_ti_board
from dechirp.recordings.settings.ti_cfg_lines import COMMANDS, Command, parse_commands_at_last_start
from dechirp.recordings.settings.ti_frame import (
    BITS,
    MAX_CHIRPS,
    TiFrame,
    ti_code,
    ti_frame_to_recording_settings,
)

_NEWER = re.compile(r"^[ \t]*(chirpComnCfg|chirpTimingCfg)\b", re.MULTILINE)
_EITHER = re.compile(r"^[ \t]*(profileCfg|frameCfg|chirpComnCfg|chirpTimingCfg)\b", re.MULTILINE)
_PLATFORM = re.compile(r"^[ \t]*%[ \t]*Platform[ \t]*:[ \t]*([\w.-]{1,40})", re.MULTILINE)
_GEOMETRY = re.compile(
    r"^[ \t]*antGeometry([01])((?:[ \t]+-?\d{1,3}){1,48})[ \t\r]*$", re.MULTILINE
)
_SIGNS = re.compile(
    r"^[ \t]*compRangeBiasAndRxChanPhase((?:[ \t]+[-.\d]{1,20}){9,49})", re.MULTILINE
)
_MAX_CHARACTERS = 2**18  # characters; real files have some 2000
_MAX_MISTAKES = 100  # more mistakes mean a wrong file

_MAX_SUB_FRAMES = 4
_REQUIRED_COMMANDS = ("channelCfg", "adcCfg", "adcbufCfg", "profileCfg", "chirpCfg")
_FRAMES = ("frameCfg",)
_SUB_FRAMES = ("advFrameCfg", "subFrameCfg")

_FOURTH_TRANSMITTER = 0b1000
_WAVEFORM = (
    *("start_ghz", "adc_start_us", "ramp_end_us"),
    *("slope_mhz_per_us", "n_samples", "sample_rate_ksps"),
)
"""Arguments of a profile that determine its chirps, without the idle time."""

_SUPPORTED_VALUES = (
    ("dfeDataOutputMode", "mode", (1, 3), "1 or 3: frames, or sub-frames"),
    ("channelCfg", "rx_mask", range(1, 2**16), "a bit for each receiver, at least one"),
    ("channelCfg", "cascading", (0,), "0: a chip alone"),
    ("adcCfg", "bits", tuple(BITS), "0, 1 or 2: 12, 14 or 16 bits"),
    ("adcCfg", "format", (0, 1, 2), "0, 1 or 2: real, or complex"),
    ("adcbufCfg", "sample_swap", (0, 1), "0 or 1"),
    ("adcbufCfg", "interleave", (0, 1), "0 or 1"),
    (
        "bpmCfg",
        "enabled",
        (0, 1),
        "0 or 1: transmitters that take turns, or pairs of chirps of two together",
    ),
    ("advFrameCfg", "n_sub_frames", range(1, _MAX_SUB_FRAMES + 1), "1 to 4 sub-frames"),
    ("advFrameCfg", "force_profile", (0,), "0: the profiles of chirpCfg"),
    ("subFrameCfg", "n_bursts", (1,), "1: one burst"),
    ("subFrameCfg", "n_burst_loops", (1,), "1: one burst"),
    ("chirpCfg", "start_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "slope_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "idle_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "adc_start_variation", (0,), "0: equal chirps"),
    ("chirpCfg", "tx_mask", range(1, 2**16), "a bit for each transmitter, at least one"),
)
"""Supported values of arguments that accept more."""


def is_ti_cfg(text: str) -> bool:
    """Return whether a text contains such commands."""
    # The pattern takes 16 ms a MB of numbers, the search for the end of its names 1 ms.
    return "Cfg" in text and _EITHER.search(text) is not None


def read_ti_cfg(file: Path, text: str, device: Device | None = None) -> RecordingSettings:
    """Read the settings that were valid when the sensor was last started.

    The last command of a kind counts. The device is the given one, else the board in a comment
    `% Platform:`, else the one with the array of the commands `antGeometry0` and `antGeometry1`,
    else see `choose_ti_board`.

    Raises
    ------
    InvalidFile
        If commands are missing, invalid or unsupported: all of them, with their lines.
    RecordingError
        If the numbers are not those of a radar.
    """
    if len(text) > _MAX_CHARACTERS:
        raise RecordingError(
            file,
            value=f"{len(text)} characters",
            expected=f"a list of commands of at most {_MAX_CHARACTERS} characters",
            fix="use the file that was sent to the radar",
        )
    xwrl_command = _NEWER.search(text)
    if xwrl_command:
        raise InvalidFile(_low_power_chip_mistake(file, text, xwrl_command))
    text = "\n".join(text.splitlines())  # some files end lines with a carriage return alone
    mistakes: list[Mistake] = []
    commands = parse_commands_at_last_start(file, text, mistakes)
    last_commands = {line.name: line for line in commands}
    mode = last_commands.get("dfeDataOutputMode")
    frames = _SUB_FRAMES if mode and mode["mode"] == 3 else _FRAMES
    _append_missing_command_mistakes(file, (*_REQUIRED_COMMANDS, *frames), last_commands, mistakes)
    if mistakes:
        raise InvalidFile(*mistakes[:_MAX_MISTAKES])
    findings: tuple[Finding, ...] = ()
    if device is None:
        device, findings = _find_device(file, text, last_commands)
    return _read_frames(file, commands, frames, device).with_findings(*findings)


def _find_device(
    file: Path, text: str, last_commands: dict[str, Command]
) -> tuple[Device | None, tuple[Finding, ...]]:
    """Return the board, and findings where words of the file's name or signs decide."""
    platform = _PLATFORM.search(text)
    chip_name = platform.group(1) if platform else ""
    profile, channels = last_commands["profileCfg"], last_commands["channelCfg"]
    named = find_device_or_none(chip_name)
    of_geometry = _device_of_geometry_commands(text, profile)
    if of_geometry is not None and of_geometry.kind().startswith(
        "" if named is None else named.kind()
    ):
        return of_geometry, ()
    signs = _SIGNS.findall(text)
    return choose_ti_board(
        file,
        chip_name=chip_name,
        start_frequency_hz=profile["start_ghz"] * 1e9,
        tx_mask=channels.integer_argument("tx_mask"),
        signs=_receiver_signs_or_none(signs[-1]) if signs else None,
    )


def _receiver_signs_or_none(words: str) -> tuple[int, ...] | None:
    """Return the signs of the receivers, equal for all transmitters; None for other factors.

    The command has a range offset, and a real and an imaginary part for each element.
    """
    try:
        values = [float(word) for word in words.split()[1:]]
    except ValueError:
        return None
    signs = tuple(int(value) for value in values[:8:2])
    is_sign = len(signs) == 4 and all(abs(sign) == 1 for sign in signs)
    equal = [part for sign in signs for part in (sign, 0)] * (len(values) // 8)
    return signs if is_sign and values == equal else None


def _read_frames(
    file: Path,
    commands: Sequence[Command],
    frames: tuple[str, ...],
    device: Device | None,
) -> RecordingSettings:
    """Read the settings of the frames, or of all sub-frames."""
    last_commands = {line.name: line for line in commands}
    if frames == _FRAMES:
        return _read_frame(file, commands, frames, device=device)
    mistakes: list[Mistake] = []
    n_sub_frames = last_commands["advFrameCfg"].integer_argument("n_sub_frames")
    # A number out of range is a mistake that the first sub-frame reports.
    numbers = range(min(max(n_sub_frames, 1), _MAX_SUB_FRAMES))
    commands_of_sub_frames = [_commands_of_sub_frame(commands, number) for number in numbers]
    for number, sub_frame_commands in enumerate(commands_of_sub_frames):
        present = {line.name: line for line in sub_frame_commands}
        _append_missing_command_mistakes(
            file, _REQUIRED_COMMANDS + frames, present, mistakes, where=f" for sub-frame {number}"
        )
    if mistakes:
        raise InvalidFile(*mistakes[:_MAX_MISTAKES])
    period_ms = sum(
        line["period_ms"]
        for sub_frame_commands in commands_of_sub_frames
        for line in sub_frame_commands[-1:]
    )
    sub_frames = [
        _read_frame(file, lines, frames, device=device, period_ms=period_ms)
        for lines in commands_of_sub_frames
    ]
    streamed = [
        settings
        for settings, lines in zip(sub_frames, commands_of_sub_frames, strict=True)
        if _is_streamed(lines)
    ]
    streamed = streamed or sub_frames
    if len(streamed) == 1:
        return streamed[0]
    return replace(streamed[0], sub_frames=tuple(streamed)).with_sub_frame(0)


def _device_of_geometry_commands(text: str, profile: Command) -> Device | None:
    """Return the device whose virtual array the last `antGeometry` commands describe."""
    geometry = {number: numbers.split() for number, numbers in _GEOMETRY.findall(text)}
    if len(geometry) < 2 or len(geometry["0"]) != len(geometry["1"]):
        return None
    left, up = (list(map(float, geometry[number])) for number in "01")
    return find_device_of_geometry(left, up, profile["start_ghz"] * 1e9)


def _commands_of_sub_frame(commands: Sequence[Command], number: int) -> list[Command]:
    """Return the commands that apply to a sub-frame; its `subFrameCfg` is the last one."""
    applicable = [line for line in commands if line.numbers.get("sub_frame", -1) in (-1, number)]
    return sorted(applicable, key=lambda line: line.name == "subFrameCfg")


def _is_streamed(commands: Sequence[Command]) -> bool:
    """Return whether the samples of a sub-frame are streamed, according to its last command."""
    streams = [line for line in commands if line.name == "lvdsStreamCfg"]
    return not streams or streams[-1]["data_format"] != 0


def _read_frame(
    file: Path,
    commands: Sequence[Command],
    frames: tuple[str, ...],
    *,
    device: Device | None,
    period_ms: float | None = None,
) -> RecordingSettings:
    """Read the settings of a frame, or of a sub-frame of frames with a period."""
    last_commands = {line.name: line for line in commands}
    frame = last_commands[frames[-1]]
    chirps = _chirp_commands_as_sent(file, commands, frame)
    _check_values_supported(file, [*last_commands.values()], chirps, frames)
    bpm = last_commands.get("bpmCfg")
    if bpm is not None and not bpm["enabled"]:
        bpm = None
    profile, pause_us = _find_common_profile(file, commands, chirps, frame, bpm)
    adc, buffer = last_commands["adcCfg"], last_commands["adcbufCfg"]
    with convert_setting_errors(file):
        ti_frame = TiFrame(
            chirp=_profile_to_chirp(profile, is_real_sampling=adc["format"] == 0),
            interval_s=(profile["idle_us"] + profile["ramp_end_us"]) / 1e6,
            masks=tuple(chirp.integer_argument("tx_mask") for chirp in chirps),
            n_loops=frame.integer_argument("n_loops"),
            n_frames=last_commands[frames[0]].integer_argument("n_frames"),
            period_s=(frame["period_ms"] if period_ms is None else period_ms) / 1e3,
            rx_mask=last_commands["channelCfg"].integer_argument("rx_mask"),
            inverted_masks=() if bpm is None else _inverted_masks(chirps, frame, bpm),
            round_pause_s=pause_us / 1e6,
            is_sub_frame=period_ms is not None and period_ms != frame["period_ms"],
        )
        settings = ti_frame_to_recording_settings(
            ti_frame,
            iq="qi" if buffer["sample_swap"] else "iq",
            interleaved=not buffer["interleave"],
            bits=BITS[adc.integer_argument("bits")],
            chip_name="",
            device=device,
        )
    stream = _describe_foreign_stream(last_commands.get("lvdsStreamCfg"))
    return replace(settings, foreign_stream=stream)


def _describe_foreign_stream(stream: Command | None) -> str:
    """Describe the settings of a stream that is not samples alone; empty for others."""
    if stream is None or not stream["data_format"]:
        return ""
    expected = {"header": 0, "data_format": 1, "software": 0}
    settings = [f"{name} {stream[name]:g}" for name in expected if stream[name] != expected[name]]
    return f"lvdsStreamCfg with {' and '.join(settings)}" if settings else ""


def _low_power_chip_mistake(file: Path, text: str, match: re.Match[str]) -> Mistake:
    """Return the mistake of a file for low-power chips."""
    return Mistake(
        setting=match.group(1),
        value="a command of the low-power chips (xWRL)",
        expected="a file with profileCfg and chirpCfg, of SDK 1 to 3",
        fix="give the radar as a YAML file; these files are not supported yet",
        file=str(file),
        line=len(text[: match.end()].splitlines()),
    )


def _append_missing_command_mistakes(
    file: Path,
    required: Sequence[str],
    commands: dict[str, Command],
    mistakes: list[Mistake],
    where: str = "",
) -> None:
    """Append a mistake for each missing command, unless it is present but invalid."""
    named = {mistake.setting for mistake in mistakes}
    mistakes += [
        Mistake(
            setting=command,
            value=f"missing{where}",
            expected=f"the command before sensorStart, with {', '.join(COMMANDS[command])}",
            fix="use the whole file that was sent to the radar",
            file=str(file),
        )
        for command in required
        if command not in commands and command not in named
    ]


def _chirp_commands_as_sent(
    file: Path, commands: Sequence[Command], frame_command: Command
) -> list[Command]:
    """Return the chirpCfg command of each chirp of a loop, in the order sent."""
    first = frame_command.integer_argument("first")
    last = (
        frame_command.integer_argument("last")
        if "last" in frame_command.numbers
        else first + frame_command.integer_argument("n_chirps") - 1
    )
    by_index = {
        index: command
        for command in commands
        if command.name == "chirpCfg"
        for index in range(
            max(command.integer_argument("first"), 0),
            min(command.integer_argument("last") + 1, MAX_CHIRPS),
        )
    }
    missing = [n for n in range(max(first, 0), min(last + 1, MAX_CHIRPS)) if n not in by_index]
    if not 0 <= first <= last < MAX_CHIRPS or missing:
        description = f"chirps {first} to {last}"
        raise InvalidFile(
            frame_command.mistake(
                file,
                value=description + (f", without chirpCfg for {missing[0]}" if missing else ""),
                expected=f"chirps within 0 to {MAX_CHIRPS - 1}, each with its chirpCfg",
                fix="correct the range, or give the missing chirps",
            )
        )
    return [by_index[index] for index in range(first, last + 1)]


def _check_values_supported(
    file: Path,
    last_commands: Sequence[Command],
    chirps: Sequence[Command],
    frame_names: Sequence[str],
) -> None:
    """Raise `InvalidFile` if the valid commands have unsupported values."""
    # Chirps are checked one by one.
    ignored = {"chirpCfg", *_FRAMES, *_SUB_FRAMES} - set(frame_names)
    commands = [line for line in last_commands if line.name not in ignored]
    commands += _unique_commands(chirps)
    mistakes = [
        line.mistake(
            file,
            value=f"{name} {line[name]:g}",
            expected=f"{name} {expected}",
            fix="record so; other values are not supported yet",
        )
        for line in commands
        for command, name, supported, expected in _SUPPORTED_VALUES
        if line.name == command and line[name] not in supported
    ]
    adc, buffer = (line for line in last_commands if line.name in ("adcCfg", "adcbufCfg"))
    if not mistakes and buffer["format"] != (adc["format"] == 0):
        mistakes = [
            buffer.mistake(
                file,
                value=f"format {buffer['format']:g}, with format {adc['format']:g} in adcCfg",
                expected="format 0 for complex samples, 1 for real ones",
                fix="correct one of the two",
            )
        ]
    if mistakes:
        raise InvalidFile(*sorted(mistakes, key=lambda mistake: mistake.line or 0))


def _find_common_profile(
    file: Path,
    commands: Sequence[Command],
    chirps: Sequence[Command],
    frame_command: Command,
    bpm: Command | None,
) -> tuple[Command, float]:
    """Return the common profile of the chirps, and the pause before the first of a loop in us.

    Profiles may differ in what the waveform does not depend on, and in the idle time of the first
    chirp. Check that transmitters use TDM or BPM pairs.
    """
    profiles = {line["profile"]: line for line in commands if line.name == "profileCfg"}
    mistakes = [
        chirp.mistake(
            file,
            value=f"profile {chirp['profile']:g}"
            + (", with another one in the same frame" if chirp["profile"] in profiles else ""),
            expected="one profile for all chirps, defined by profileCfg",
            fix="record equal chirps; others are not supported yet",
        )
        for chirp in _unique_commands(chirps)
        if chirp["profile"] not in profiles
        or not _is_same_waveform(profiles[chirp["profile"]], profiles.get(chirps[-1]["profile"]))
    ]
    idle_us = [profiles[chirp["profile"]]["idle_us"] for chirp in chirps] if not mistakes else []
    if idle_us and (len({*idle_us[1:]}) > 1 or idle_us[0] < idle_us[-1]):
        mistakes = [
            chirp.mistake(
                file,
                value=f"an idle time of {idle:g} us, after {idle_us[0]:g} us of the first chirp",
                expected="equal idle times, but for a longer one before each loop",
                fix="record so; others are not supported yet",
            )
            for chirp, idle in zip(chirps[1:], idle_us[1:], strict=True)
            if idle != idle_us[0]
        ][:1]
    if bpm is not None:
        mistakes += _bpm_mistakes(file, chirps, frame_command, bpm)
    if not mistakes:
        mistakes += _transmitter_mistakes(file, chirps, frame_command, bpm)
    if mistakes:
        raise InvalidFile(*mistakes)
    return profiles[chirps[-1]["profile"]], idle_us[0] - idle_us[-1]


def _is_same_waveform(profile: Command, other: Command | None) -> bool:
    """Return whether two profiles have the same chirps, except for their idle times."""
    return other is not None and all(profile[name] == other[name] for name in _WAVEFORM)


def _transmitter_mistakes(
    file: Path, chirps: Sequence[Command], frame_command: Command, bpm: Command | None
) -> list[Mistake]:
    """Return the mistakes of transmitters that the chirps do not separate.

    Demos of chips with four transmitters divide them by Doppler, with phases that no command sets.
    """
    masks = [chirp.integer_argument("tx_mask") for chirp in chirps]
    divided = [chirp for chirp in _unique_commands(chirps) if _has_several(chirp)]
    if divided and max(masks) >= _FOURTH_TRANSMITTER:
        return [
            chirp.mistake(
                file,
                value=f"tx_mask {chirp['tx_mask']:g}, of a chip with four transmitters",
                expected="a tx_mask of one bit: its demo divides several by Doppler",
                fix="give the radar as a YAML file with multiplexing of kind ddma",
            )
            for chirp in divided
        ]
    try:
        ti_code(masks, () if bpm is None else _inverted_masks(chirps, frame_command, bpm))
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        several = [chirp for chirp in _unique_commands(chirps) if _has_several(chirp)]
        if several and bpm is None:
            return [
                chirp.mistake(
                    file,
                    value=f"tx_mask {chirp['tx_mask']:g}",
                    expected="a tx_mask of one bit (one transmitter) unless bpmCfg is enabled, or"
                    " the same tx_mask for all chirps",
                    fix="record so, or give the radar as a YAML file with its multiplexing",
                )
                for chirp in several
            ]
        value = f"chirps of transmitters {mistake.value}" if not several else mistake.value
        return [
            frame_command.mistake(file, value=value, expected=mistake.expected, fix=mistake.fix)
        ]
    return []


def _has_several(chirp: Command) -> bool:
    """Return whether several transmitters send in a chirp."""
    return chirp.integer_argument("tx_mask").bit_count() > 1


def _inverted_masks(
    chirps: Sequence[Command], frame_command: Command, bpm: Command
) -> tuple[int, ...]:
    """Return the transmitters of each chirp with the opposite sign, a bit each.

    The demo sends the first chirp of a pair without phase shift, the second with 180 degrees on
    the later transmitter (SDK User Guide, bpmCfg).
    """
    second = int(bpm["second"] - frame_command["first"])
    return tuple(
        1 << chirp.integer_argument("tx_mask").bit_length() - 1 if index == second else 0
        for index, chirp in enumerate(chirps)
    )


def _bpm_mistakes(
    file: Path, chirps: Sequence[Command], frame_command: Command, bpm: Command
) -> list[Mistake]:
    """Return the mistakes of the pair of chirps that two transmitters send together."""
    masks = [chirp.integer_argument("tx_mask") for chirp in chirps]
    pair = [int(bpm[name] - frame_command["first"]) for name in ("first", "second")]
    is_pair = (
        0 <= pair[0] < pair[1] < len(masks)
        and masks[pair[0]] == masks[pair[1]]
        and masks[pair[0]].bit_count() == 2
        and all(mask.bit_count() == 1 for index, mask in enumerate(masks) if index not in pair)
    )
    if is_pair:
        return []
    mask_text = ", ".join(map(str, masks[:8])) + (" ..." if len(masks) > 8 else "")
    return [
        bpm.mistake(
            file,
            value=f"enabled 1, for chirps {bpm['first']:g} and {bpm['second']:g}, in a frame"
            f" of chirps with tx_mask {mask_text}",
            expected="two chirps of the frame in the order sent, both with the same two"
            " transmitters, beside chirps of one transmitter; or enabled 0",
            fix="record so, or give the radar as a YAML file with its multiplexing",
        )
    ]


def _unique_commands(chirps: Sequence[Command]) -> list[Command]:
    """Return each command once, in the order of the chirps."""
    return [*{chirp.line_number: chirp for chirp in chirps}.values()]


def _profile_to_chirp(profile: Command, *, is_real_sampling: bool) -> Chirp:
    """Convert a profile to a chirp."""
    return Chirp(
        start_frequency_hz=profile["start_ghz"] * 1e9,
        slope_hz_per_s=profile["slope_mhz_per_us"] * 1e12,
        adc_start_s=profile["adc_start_us"] / 1e6,
        ramp_duration_s=profile["ramp_end_us"] / 1e6,
        sample_rate_hz=profile["sample_rate_ksps"] * 1e3,
        n_samples=profile.integer_argument("n_samples"),
        sampling="real" if is_real_sampling else "complex",
    )
