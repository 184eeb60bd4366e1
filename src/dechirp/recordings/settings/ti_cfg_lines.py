"""Commands in the lines of a TI configuration file, with their numbers."""

import re
from pathlib import Path

from dechirp.core.errors import Mistake
from dechirp.core.values import frozen_dataclass

_NUMBER = re.compile(r"[+-]?(\d{1,17}\.?\d{0,17}|\.\d{1,17})([eE][+-]?\d{1,3})?", re.ASCII)
_FRACTIONS = ("_ghz", "_us", "_ms", "_mhz_per_us", "_variation")
"""Endings of names of numbers that may have a fraction."""

COMMANDS = {
    "dfeDataOutputMode": ("mode",),
    "channelCfg": ("rx_mask", "tx_mask", "cascading"),
    "adcCfg": ("bits", "format"),
    # The first demos, and those of xWR14xx, have no sub-frames.
    "adcbufCfg": ("sub_frame", "format", "sample_swap", "interleave", "chirp_threshold"),
    "profileCfg": (
        "profile",
        "start_ghz",
        "idle_us",
        "adc_start_us",
        "ramp_end_us",
        "backoff",
        "phase_shifter",
        "slope_mhz_per_us",
        "tx_start_us",
        "n_samples",
        "sample_rate_ksps",
        "high_pass_1",
        "high_pass_2",
        "gain",
    ),
    "chirpCfg": (
        "first",
        "last",
        "profile",
        "start_variation",
        "slope_variation",
        "idle_variation",
        "adc_start_variation",
        "tx_mask",
    ),
    "frameCfg": (
        "first",
        "last",
        "n_loops",
        "n_frames",
        "period_ms",
        "trigger",
        "trigger_delay_ms",
    ),
    "advFrameCfg": ("n_sub_frames", "force_profile", "n_frames", "trigger", "trigger_delay_ms"),
    "subFrameCfg": (
        "sub_frame",
        "force_profile",
        "first",
        "n_chirps",
        "n_loops",
        "burst_period_ms",
        "offset",
        "n_bursts",
        "n_burst_loops",
        "period_ms",
    ),
    "bpmCfg": ("sub_frame", "enabled", "first", "second"),
    "lvdsStreamCfg": ("sub_frame", "header", "data_format", "software"),
}
"""Argument names of each command about the waveform or the data format, in order."""


@frozen_dataclass
class Command:
    """One command."""

    line_number: int
    """Line number, from 1."""
    name: str
    numbers: dict[str, float]
    """Arguments, by the names in `COMMANDS`."""

    def __getitem__(self, name: str) -> float:
        return self.numbers[name]

    def integer_argument(self, name: str) -> int:
        """Return an argument that was checked to be an integer."""
        return int(self.numbers[name])

    def mistake(self, file: Path, *, value: str, expected: str, fix: str) -> Mistake:
        """Return a mistake in this command."""
        return Mistake(
            setting=self.name,
            value=value,
            expected=expected,
            fix=fix,
            file=str(file),
            line=self.line_number,
        )


def parse_commands_at_last_start(file: Path, text: str, mistakes: list[Mistake]) -> list[Command]:
    """Return the commands that were valid when the sensor was last started; append `mistakes`.

    Commands before a `flushCfg` were discarded by the chip, and commands after the last
    `sensorStart` were not yet valid. Commands of the demo's own processing are ignored.
    """
    flush_line, numbered_lines = 0, []
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if _first_word(line) == "sensorStart"]
    for number, line in enumerate(lines[: starts[-1]] if starts else lines, start=1):
        command = _first_word(line)
        if command == "flushCfg":
            flush_line = number
        elif command in COMMANDS:
            numbered_lines.append((number, line.partition("%")[0].split()))
    numbered_words = [(number, words) for number, words in numbered_lines if number > flush_line]
    commands = [
        _parse_command(file, number, words[0], words[1:], mistakes)
        for number, words in numbered_words
    ]
    return [line for line in commands if line]


def _first_word(line: str) -> str:
    """Return the first word of a line, without its comment."""
    return line.partition("%")[0].strip().partition(" ")[0].partition("\t")[0]


def _parse_command(
    file: Path, number: int, command: str, words: list[str], mistakes: list[Mistake]
) -> Command | None:
    """Parse a command; append a mistake and return None if it is invalid."""
    names = COMMANDS[command]
    if command == "adcbufCfg" and len(words) == 4:
        names = names[1:]
    parsed = {name: _parse_argument(name, word) for name, word in zip(names, words, strict=False)}
    numbers = {
        name: number_or_none
        for name, number_or_none in parsed.items()
        if number_or_none is not None
    }
    parsed_command = Command(line_number=number, name=command, numbers=numbers)
    # The chip's own parser accepts exactly this number; newer chips add to channelCfg.
    is_count_valid = len(words) == len(names) or (
        command == "channelCfg" and len(names) <= len(words) <= 6
    )
    if is_count_valid and len(numbers) == len(names):
        return parsed_command
    if is_count_valid:
        bad_numbers = [
            f"{name} {words[names.index(name)][:20]!r}" for name in names if name not in numbers
        ]
        value, expected = (
            ", ".join(bad_numbers),
            "numbers, and integers for counts",
        )
    else:
        value = f"{len(words)} numbers"
        expected = f"{len(names)} numbers: {', '.join(names)}"
    fix = "use the file that was sent to the radar"
    if command == "frameCfg" and len(words) == 6:
        fix = "give the radar as YAML; files with chirpComnCfg and chirpTimingCfg are not supported"
    elif command == "frameCfg" and len(words) == 8:
        fix = "give the radar as YAML; files of AWR2944 and AWR2544 are not supported yet"
    mistakes.append(parsed_command.mistake(file, value=value, expected=expected, fix=fix))
    return None


def _parse_argument(name: str, word: str) -> float | None:
    """Return a number; None if it is invalid, or has a fraction where it may not."""
    number = float(word) if _NUMBER.fullmatch(word) else None
    # The largest numbers are 24-bit codes: back-off and phase of three transmitters.
    if number is None or abs(number) >= 2**24 or (not name.endswith(_FRACTIONS) and number % 1):
        return None
    return number
