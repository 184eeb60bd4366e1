"""TI mmWave Studio: Lua scripts that set up the radar (`ar1.ProfileConfig(0, 77, 100, ...)`).

Numbers are in the units of mmWave Studio's help texts: GHz, us, MHz/us, kS/s and ms. They may be
computed from variables of the script. Loops over numbers (`for i = 0, 2 do ... end`) are executed
if they contain no other loop or branch; branches are not: of several calls for the same profile or
chirp the last one counts.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.recordings.settings.antenna_positions import find_device_or_none
from dechirp.recordings.settings.base import RecordingSettings, convert_setting_errors
from dechirp.recordings.settings.ti_board import choose_ti_board
from dechirp.recordings.settings.ti_frame import (
    BITS,
    CHIRP_PHASES,
    MAX_CHIRPS,
    TiFrame,
    ti_frame_to_recording_settings,
)

_MAX_CHARACTERS = 2**18  # real scripts have some 10,000
_MAX_EXPRESSION = 200
_MAX_NUMBER = 1e9

_ARGUMENTS = {
    "ChanNAdcConfig": "tx1 tx2 tx3 rx1 rx2 rx3 rx4 bits format iq_swap",
    "ProfileConfig": "profile start_ghz idle_us adc_start_us ramp_end_us backoff1 backoff2 backoff3"
    " phase1 phase2 phase3 slope_mhz_per_us tx_start_us n_samples sample_rate_ksps",
    "ChirpConfig": "first last profile start_variation slope_variation idle_variation"
    " adc_start_variation tx1 tx2 tx3",
    "FrameConfig": "first last n_frames n_loops period_ms",
}
"""Names of the arguments that matter; others may follow."""
_VARIATIONS = ("start_variation", "slope_variation", "idle_variation", "adc_start_variation")
_WITH_FRACTION = re.compile(r"_(ghz|us|ms|variation)$|^(backoff|phase)\d$")
# Arguments of chips with three transmitters; a profile ends with its high-pass filters and gain.
_MAX_COUNTS = {"ProfileConfig": 18, "ChirpConfig": 10}

# Strings are matched first, because they may contain dashes.
_COMMENT = re.compile(r"(\"[^\"\n]*\"|'[^'\n]*')|--\[(=*)\[.*?\]\2\]|--[^\n]*", re.DOTALL)
_NAME = r"[A-Za-z_]\w*"
_STATEMENT = re.compile(
    r"ar1\.(?P<call>\w+)\s*\(|"
    rf"^[ \t]*(?:local\s+)?(?P<name>{_NAME}(?:\.{_NAME})*)[ \t]*=(?!=)(?P<value>[^\n;]*)",
    re.MULTILINE,
)
_LOOP = re.compile(
    rf"\bfor\s+(?P<name>{_NAME})[ \t]*=(?P<range>[^\n;]{{1,200}}?)\s+do\b"
    r"(?P<body>(?:(?!\b(?:for|while|if|repeat|function|do|end)\b).){0,4000})\bend\b",
    re.DOTALL,
)
_MAX_TURNS = 2 * MAX_CHIRPS  # of all loops of a script
_EXPRESSION = re.compile(r"[\w.+\-*/() ]+", re.ASCII)
_OPERATORS: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}

Numbers = dict[str, float]


def is_mmwave_lua(text: str) -> bool:
    """Return whether a text contains calls of such a script."""
    return re.search(r"ar1\.ProfileConfig(_mult)?\s*\(", text) is not None


def read_mmwave_lua(file: Path, text: str, device: Device | None = None) -> RecordingSettings:
    """Read the settings of a script.

    The device is the given one, else the chip that the script selects last, or an
    earlier one that the name of the file contains.

    Raises
    ------
    RecordingError
        If a call is missing, or its numbers are invalid or depend on more than variables; if the
        chirps of the frame differ in more than their transmitters, or several send at once.
    """
    if len(text) > _MAX_CHARACTERS or re.search(r"ar1\.ProfileConfig_mult\s*\(", text):
        raise RecordingError(
            file,
            value="calls for a cascade of chips (ProfileConfig_mult)"
            if len(text) <= _MAX_CHARACTERS
            else f"{len(text)} characters",
            expected="a script that sets up a single chip",
            fix="give the .mmwave.json file of the capture, or the radar as a YAML file",
        )
    calls = _parse_calls(text)
    known_device, board_findings = (device, ()) if device is not None else _find_device(file, calls)
    latest = {call.name: call for call in calls if call.name in _ARGUMENTS}
    missing = sorted({"ProfileConfig", "ChirpConfig", "FrameConfig"} - latest.keys())
    advanced = [call for call in calls if call.name == "AdvanceFrameConfig"]
    if missing or (advanced and advanced[-1].line > latest["FrameConfig"].line):
        raise RecordingError(
            file,
            value=f"no {', '.join(missing)}"
            if missing
            else f"AdvanceFrameConfig in line {advanced[-1].line}",
            expected="ar1.ProfileConfig, ar1.ChirpConfig and ar1.FrameConfig",
            fix="give the script that set up the radar, its log file, or its .mmwave.json file",
        )
    frame = latest["FrameConfig"].numbers(file)
    profile, masks, findings = _find_profile_and_masks(file, calls, frame, known_device)
    channels = latest.get("ChanNAdcConfig")
    if channels is None:
        rx_mask, bits, sample_format, iq_swap = 0b1111, 2.0, 1.0, None
        findings += (_assumed_channels_warning(),)
    else:
        numbers = channels.numbers(file)
        rx_mask = sum((int(numbers[f"rx{n + 1}"]) & 1) << n for n in range(4))
        bits, sample_format, iq_swap = (numbers[key] for key in ("bits", "format", "iq_swap"))
        if bits not in BITS or sample_format not in (0, 1, 2) or iq_swap not in (0, 1):
            raise RecordingError(
                file,
                value=f"ChanNAdcConfig with bits {bits:g}, format {sample_format:g}, IQSwap"
                f" {iq_swap:g} in line {channels.line}",
                expected="bits 0 to 2, format 0 (real), 1 or 2 (complex), IQSwap 0 or 1",
                fix="record so; other layouts are not supported yet",
            )
    with convert_setting_errors(file):
        ti_frame = TiFrame(
            chirp=_profile_to_chirp(profile, is_real_sampling=sample_format == 0),
            interval_s=(profile["idle_us"] + profile["ramp_end_us"]) / 1e6,
            masks=masks,
            n_loops=int(frame["n_loops"]),
            n_frames=int(frame["n_frames"]),
            period_s=frame["period_ms"] / 1e3,
            rx_mask=rx_mask,
        )
        settings = ti_frame_to_recording_settings(
            ti_frame,
            iq=None if iq_swap is None else ("qi" if iq_swap else "iq"),
            interleaved=None,
            bits=BITS[int(bits)],
            chip_name="",
            device=known_device,
        )
    settings = settings.with_findings(*board_findings, *findings)
    return settings.completed_from_device(known_device)


def _find_device(file: Path, calls: list["_Call"]) -> tuple[Device | None, tuple[Finding, ...]]:
    """Return the board of the script, and findings where the name of the file decides.

    The last chip that the script selects counts, unless the name contains another one of them:
    `1642_config.lua` selects an AR1642, then an XWR1843.
    """
    names = [call.text.strip(" \"'") for call in calls if call.name == "SelectChipVersion"]
    chips = [chip for chip in map(find_device_or_none, names) if chip is not None]
    starts_ghz = [
        call.values[1] for call in calls if call.name == "ProfileConfig" and len(call.values) > 1
    ]
    start_ghz = starts_ghz[-1] if starts_ghz and starts_ghz[-1] is not None else 0.0
    for chip in reversed(chips):
        board, findings = choose_ti_board(
            file,
            chip_name="" if len(chips) > 1 else chip.kind(),
            start_frequency_hz=1e9 * start_ghz,
            tx_mask=1,
        )
        if board is not None and board.kind().startswith(chip.kind()):
            return board, findings
    return (chips[-1], ()) if chips else (None, ())


@frozen_dataclass
class _Call:
    """One call."""

    line: int
    name: str
    text: str
    """The arguments."""
    values: tuple[float | None, ...]
    """Numbers of the arguments of a call that matters; None for other expressions."""

    def numbers(self, file: Path) -> Numbers:
        """Return the arguments by name; raise `RecordingError` if they are invalid."""
        names = _ARGUMENTS[self.name].split()
        if not len(names) <= len(self.values) <= _MAX_COUNTS.get(self.name, len(self.values)):
            raise RecordingError(
                file,
                value=f"{self.name} with {len(self.values)} arguments in line {self.line}",
                expected=f"{', '.join(names)}",
                fix="give the .mmwave.json file of the capture, or the radar as a YAML file",
            )
        expressions = self.text.split(",")
        for name, expression, number in zip(names, expressions, self.values, strict=False):
            if number is None or not (number.is_integer() or _WITH_FRACTION.search(name)):
                raise RecordingError(
                    file,
                    value=f"{name} {expression.strip()[:40]!r} of {self.name} in line {self.line}",
                    expected="an integer"
                    if number is not None
                    else "a number, or an expression of numbers and variables",
                    fix="write the number there, or give the log of mmWave Studio, which contains"
                    " all numbers",
                )
        return {name: number or 0.0 for name, number in zip(names, self.values, strict=False)}


def _parse_calls(text: str) -> list[_Call]:
    """Return the calls before the frames are last started, in their order."""
    code = _COMMENT.sub(lambda match: match[1] or "\n" * match[0].count("\n"), text)
    calls: list[_Call] = []
    variables: Numbers = {}
    start, n_turns = 0, 0
    for loop in _LOOP.finditer(code):
        calls += _parse_calls_of_block(code, start, loop.start(), variables)
        start = loop.end()
        values = _loop_values(loop["range"], variables)
        n_turns += len(values)
        if not values or n_turns > _MAX_TURNS:  # its variable stays unknown
            calls += _parse_calls_of_block(code, loop.start("body"), loop.end("body"), variables)
            continue
        for value in values:
            variables[loop["name"]] = value
            calls += _parse_calls_of_block(code, loop.start("body"), loop.end("body"), variables)
        variables.pop(loop["name"], None)
    calls += _parse_calls_of_block(code, start, len(code), variables)
    starts = [index for index, call in enumerate(calls) if call.name == "StartFrame"]
    return calls[: starts[-1]] if starts else calls


def _loop_values(text: str, variables: Numbers) -> list[float]:
    """Return the values of `first, last` or `first, last, step`; none for other expressions."""
    numbers = [_evaluate_or_none(part, variables) for part in text.split(",")]
    known = [number for number in numbers if number is not None]
    if len(known) != len(numbers) or not 2 <= len(known) <= 3:
        return []
    first, last, step = (*known, 1.0)[:3]
    n_steps = math.floor(min((last - first) / step, _MAX_TURNS)) if step else -1
    return [first + step * index for index in range(n_steps + 1)]


def _parse_calls_of_block(code: str, start: int, end: int, variables: Numbers) -> Iterator[_Call]:
    """Yield the calls of a part of the code, and update the variables that it assigns."""
    line, position = code.count("\n", 0, start) + 1, start
    for match in _STATEMENT.finditer(code, start, end):
        if match["name"]:
            number = _evaluate_or_none(match["value"].strip().rstrip(","), variables)
            variables.pop(match["name"], None)
            if number is not None:
                variables[match["name"]] = number
            continue
        line, position = line + code.count("\n", position, match.start()), match.start()
        arguments = _arguments_to_closing_bracket(code, match.end())
        values = (
            tuple(_evaluate_or_none(part, variables) for part in arguments.split(","))
            if match["call"] in _ARGUMENTS
            else ()
        )
        yield _Call(line=line, name=match["call"], text=arguments, values=values)


def _arguments_to_closing_bracket(code: str, start: int) -> str:
    """Return the text up to the bracket that closes a call."""
    depth = 1
    for end in range(start, min(len(code), start + 10 * _MAX_EXPRESSION)):
        depth += (code[end] == "(") - (code[end] == ")")
        if not depth:
            return code[start:end]
    return code[start : start + _MAX_EXPRESSION]


def _evaluate_or_none(expression: str, variables: Numbers) -> float | None:
    """Return the value of an expression of numbers and variables; None for any other."""
    expression = " ".join(expression.split())
    if len(expression) > _MAX_EXPRESSION or not _EXPRESSION.fullmatch(expression):
        return None
    try:
        number = _evaluate(ast.parse(expression, mode="eval").body, variables)
    except (SyntaxError, ValueError, ArithmeticError, RecursionError, MemoryError, LookupError):
        return None
    return number if abs(number) <= _MAX_NUMBER else None


def _evaluate(node: ast.expr, variables: Numbers) -> float:
    """Return the value of a node; raise `ValueError` or `LookupError` without one."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name | ast.Attribute):
        return variables[ast.unparse(node)]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_evaluate(node.operand, variables)
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        left, right = (_evaluate(side, variables) for side in (node.left, node.right))
        return _OPERATORS[type(node.op)](left, right)
    raise ValueError(ast.dump(node)[:40])


def _find_profile_and_masks(
    file: Path, calls: list[_Call], frame: Numbers, device: Device | None
) -> tuple[Numbers, tuple[int, ...], tuple[Finding, ...]]:
    """Return the common profile of the chirps of the frame, the transmitters, and findings."""
    chirps: dict[int, Numbers] = {}
    for call in calls:
        if call.name == "ChirpConfig":
            numbers = call.numbers(file)
            for index in range(
                max(int(numbers["first"]), 0), min(int(numbers["last"]), MAX_CHIRPS - 1) + 1
            ):
                chirps[index] = numbers
    first, last = int(frame["first"]), int(frame["last"])
    used = [chirps.get(index) for index in range(max(first, 0), min(last + 1, MAX_CHIRPS))]
    profiles = {chirp["profile"] for chirp in used if chirp}
    is_valid = 0 <= first <= last < MAX_CHIRPS and all(used) and len(profiles) == 1
    if not is_valid or any(chirp[key] for chirp in used if chirp for key in _VARIATIONS):
        raise RecordingError(
            file,
            value=f"chirps {first} to {last} of the frame, which differ or are not set",
            expected="equal chirps, of any transmitters in turn",
            fix="record equal chirps; others are not supported yet",
        )
    masks = tuple(sum(bool(chirp[f"tx{n + 1}"]) << n for n in range(3)) for chirp in used if chirp)
    phases = [call for call in calls if CHIRP_PHASES.search(call.name)]
    if phases and any(mask.bit_count() > 1 for mask in masks):
        raise RecordingError(
            file,
            value=f"chirps of several transmitters, with {phases[0].name} in line {phases[0].line}",
            expected="one transmitter in each chirp, or equal phases of all in every chirp",
            fix="give the .mmwave.json file of the capture, or the radar as a YAML file with its"
            " multiplexing",
        )
    profile, findings = _find_profile(file, calls, profiles.pop(), device)
    return profile, masks, findings


def _find_profile(
    file: Path, calls: list[_Call], number: float, device: Device | None
) -> tuple[Numbers, tuple[Finding, ...]]:
    """Return the last profile of a number within the bands of the device."""
    profiles = [call.numbers(file) for call in calls if call.name == "ProfileConfig"]
    profiles = [profile for profile in profiles if profile["profile"] == number]
    if device is not None:
        profiles = [*_profiles_in_bands(profiles, device)] or profiles
    if not profiles:
        raise RecordingError(
            file,
            value=f"chirps with profile {number:g}, which is not set",
            expected=f"ar1.ProfileConfig({number:g}, ...)",
            fix="give the whole script",
        )
    if all(profile == profiles[-1] for profile in profiles):
        return profiles[-1], ()
    warning = Finding(
        level="warning",
        setting="radar.frame.chirp",
        value=f"{len(profiles)} different calls of ProfileConfig for profile {number:g}, of which"
        f" the last is used: {profiles[-1]['start_ghz']:g} GHz",
        expected="one set of numbers, since branches of a script are not executed",
        fix="give the device (--device NAME) if the script is for several, or give the radar",
    )
    return profiles[-1], (warning,)


def _profiles_in_bands(profiles: list[Numbers], device: Device) -> Iterator[Numbers]:
    """Yield the profiles that start within a band of the device."""
    for profile in profiles:
        start_hz = profile["start_ghz"] * 1e9
        if any(low <= start_hz <= high for low, high in device.limits.bands_hz):
            yield profile


def _assumed_channels_warning() -> Finding:
    """Warn that the script does not configure the receivers."""
    return Finding(
        level="warning",
        setting="radar.array.rx",
        value="no ChanNAdcConfig in the script, assumed: four receivers, complex 16-bit samples",
        expected="the receivers and samples that were in use",
        fix="give the whole script, or the radar as a YAML file",
    )


def _profile_to_chirp(profile: Numbers, *, is_real_sampling: bool) -> Chirp:
    """Convert a profile to a chirp."""
    return Chirp(
        start_frequency_hz=profile["start_ghz"] * 1e9,
        slope_hz_per_s=profile["slope_mhz_per_us"] * 1e12,
        adc_start_s=profile["adc_start_us"] / 1e6,
        ramp_duration_s=profile["ramp_end_us"] / 1e6,
        sample_rate_hz=profile["sample_rate_ksps"] * 1e3,
        n_samples=int(profile["n_samples"]),
        sampling="real" if is_real_sampling else "complex",
    )
