"""Lines of a TI command-line file: commands, and the numbers they give."""

import re
from pathlib import Path

from dechirp.core.errors import Mistake
from dechirp.core.values import value

_NUMBER = re.compile(r"[+-]?(\d{1,17}\.?\d{0,17}|\.\d{1,17})([eE][+-]?\d{1,3})?", re.ASCII)
_FRACTIONS = ("_ghz", "_us", "_ms", "_mhz_per_us", "_variation")
"""Ends of names of numbers that need not be whole."""

COMMANDS = {
    "dfeDataOutputMode": ("mode",),
    "channelCfg": ("rx_mask", "tx_mask", "cascading"),
    "adcCfg": ("bits", "format"),
    # The first demos, and those of xWR14xx, know no sub-frames.
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
"""Numbers of each command that says what was sent or how it was kept, by name, in order."""


@value
class Line:
    """One command."""

    number: int
    """Counted from 1."""
    command: str
    numbers: dict[str, float]
    """By the names in `COMMANDS`."""

    def __getitem__(self, name: str) -> float:
        return self.numbers[name]

    def whole(self, name: str) -> int:
        """A number that was found to be whole."""
        return int(self.numbers[name])

    def mistake(self, file: Path, *, got: str, need: str, fix: str) -> Mistake:
        """Say what is wrong with this command."""
        return Mistake(
            setting=self.command, got=got, need=need, fix=fix, file=str(file), line=self.number
        )


def lines_of(file: Path, text: str, wrong: list[Mistake]) -> list[Line]:
    """Commands that held when the sensor was started last; `wrong` takes the mistakes.

    What comes before a `flushCfg` was forgotten by the chip, what comes after the last
    `sensorStart` did not hold yet. Commands of the demo's own processing are left out.
    """
    first, found = 0, []
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if _first_word(line) == "sensorStart"]
    for number, line in enumerate(lines[: starts[-1]] if starts else lines, start=1):
        command = _first_word(line)
        if command == "flushCfg":
            first = number
        elif command in COMMANDS:
            found.append((number, line.partition("%")[0].split()))
    held = [(number, words) for number, words in found if number > first]
    made = [_line(file, number, words[0], words[1:], wrong) for number, words in held]
    return [line for line in made if line]


def _first_word(line: str) -> str:
    return line.partition("%")[0].strip().partition(" ")[0].partition("\t")[0]


def _line(
    file: Path, number: int, command: str, words: list[str], wrong: list[Mistake]
) -> Line | None:
    names = COMMANDS[command]
    if command == "adcbufCfg" and len(words) == 4:
        names = names[1:]
    read = {name: _number(name, word) for name, word in zip(names, words, strict=False)}
    numbers = {name: found for name, found in read.items() if found is not None}
    line = Line(number=number, command=command, numbers=numbers)
    # The chip's own parser takes neither more nor fewer; newer chips add to channelCfg.
    right_count = len(words) == len(names) or (
        command == "channelCfg" and len(names) <= len(words) <= 6
    )
    if right_count and len(numbers) == len(names):
        return line
    if right_count:
        bad = [f"{name} {words[names.index(name)][:20]!r}" for name in names if name not in numbers]
        got, need = f"given with {', '.join(bad)}", "given numbers, whole ones where they count"
    else:
        got = f"given {len(words)} numbers"
        need = f"given {len(names)}: {', '.join(names)}"
    fix = "Take the file as it was sent to the radar."
    if command == "frameCfg" and len(words) == 6:
        fix = "Files of the chips that have chirpComnCfg and chirpTimingCfg are not read yet."
    elif command == "frameCfg" and len(words) == 8:
        fix = "Files of newer chips (AWR2944, AWR2544) are not read yet: give the radar as YAML."
    wrong.append(line.mistake(file, got=got, need=need, fix=fix))
    return None


def _number(name: str, word: str) -> float | None:
    found = float(word) if _NUMBER.fullmatch(word) else None
    # The largest are codes of 24 bits: back-off and phase of three transmitters.
    if found is None or abs(found) >= 2**24 or (not name.endswith(_FRACTIONS) and found % 1):
        return None
    return found
