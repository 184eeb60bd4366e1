"""TI mmWave Studio: the log of the calls that set the radar up (`LogFile.txt`)."""

import re
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.formats.settings.base import Settings, values_from
from dechirp.formats.settings.receivers import assumed, assumed_line
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_CALL = re.compile(r"API:(\w+),(.*)")

_TIME_S = 10e-9
_PERIOD_S = 5e-9
# The synthesiser counts 2^26 steps of 3.6 GHz in 77 GHz chips, of 2.7 GHz in 60 GHz ones.
_REFERENCE_77_HZ = 3.6e9
_REFERENCE_60_HZ = 2.7e9

_NEEDED = {
    "ChannelConfig": 2,
    "DataFmtConfig": 5,
    "ProfileConfig": 11,
    "ChirpConfig": 8,
    "FrameConfig": 5,
}
"""Calls that must have been made, and how many numbers each must give."""

Call = tuple[int, ...]


def looks_like(text: str) -> bool:
    """Whether a text is such a log."""
    return "API:ProfileConfig," in text


def read(file: Path, text: str) -> Settings:
    """Read the settings that held when the sensor was started last.

    A frame of one chirp has no slow time. Such frames, sent one after the other, are
    taken as the chirps of one frame, and a finding says so.

    Raises
    ------
    RecordingError
        If a call is missing or not understood, the chirps of a frame differ, or the
        samples are not kept as 16-bit complex numbers, one receiver after the other.
    """
    chip, calls = _calls(file, text)
    profiles = {call[0]: call for call in calls["ProfileConfig"]}
    channel, layout, frame = (
        calls[name][-1] for name in ("ChannelConfig", "DataFmtConfig", "FrameConfig")
    )
    _, bits, form, iq_swap, interleave = layout[:5]
    if bits != 2 or form not in (1, 2) or interleave != 1 or iq_swap not in (0, 1):
        raise RecordingError(
            file,
            got=f"DataFmtConfig with bits {bits}, format {form}, iqSwap {iq_swap},"
            f" chInterleave {interleave}",
            need="16-bit complex samples (2; 1 or 2), iqSwap 0 or 1, and receivers one after"
            " the other (1)",
            fix="Record it so; other layouts are not read yet.",
        )
    first, last, n_frames, n_loops, period = frame[:5]
    profile = _one_profile(file, calls["ChirpConfig"], profiles, range(first, last + 1))
    n_chirps = n_loops * (last - first + 1)
    period_s = period * _PERIOD_S
    n_rx = channel[1].bit_count()
    findings = [assumed(n_rx)] if n_rx > 1 else []
    with values_from(file):
        chirp = _chirp(chip, profile)
        merged = n_chirps == 1
        if merged:
            made = Frame(chirp=chirp, n_chirps=n_frames, interval_s=period_s)
            findings.append(_one_chirp_a_frame(n_frames, period_s))
            n_frames = 1
        else:
            interval_s = (profile[2] + profile[4]) * _TIME_S
            made = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=interval_s, period_s=period_s)
        radar = Radar(frame=made, array=assumed_line(chirp, n_rx))
    return Settings(
        radar=radar,
        iq="qi" if iq_swap else "iq",
        n_frames=n_frames or None,  # 0: until stopped
        merged=merged,
        findings=tuple(findings),
    )


def _calls(file: Path, text: str) -> tuple[str, dict[str, list[Call]]]:
    """Name of the chip, and the calls made before the last start, by name and in order."""
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if "API:SensorStart," in line]
    chip = ""
    calls: dict[str, list[Call]] = {name: [] for name in _NEEDED}
    for number, line in enumerate(lines[: starts[-1]] if starts else lines, start=1):
        call = _CALL.search(line)
        if call is None:
            continue
        name, rest = call.groups()
        if name == "select_chip_version":
            chip = rest.split(",")[0]
        elif name in calls:
            calls[name].append(_numbers(file, number, name, rest))
    missing = [name for name, made in calls.items() if not made]
    if missing:
        raise RecordingError(
            file,
            got=f"a log without {', '.join(missing)}",
            need="a log with every call that sets the radar up",
            fix="Take the whole log, from the first call to SensorStart.",
        )
    return chip, calls


def _numbers(file: Path, line: int, name: str, text: str) -> Call:
    try:
        numbers = tuple(int(word) for word in text.strip().rstrip(",").split(","))
    except ValueError:
        numbers = ()
    if len(numbers) < _NEEDED[name]:
        raise RecordingError(
            file,
            got=f"{name} with {text.strip()[:60]!r} in line {line}",
            need=f"{name} with at least {_NEEDED[name]} whole numbers",
            fix="Take the log as mmWave Studio wrote it.",
        )
    return numbers


def _one_profile(file: Path, made: list[Call], profiles: dict[int, Call], sent: range) -> Call:
    """Give the profile of all chirps of the frame, which must be equal."""
    # Profile, then the changes to it, then which transmitters send.
    chirps = {index: call[2:] for call in made for index in range(call[0], min(call[1], 511) + 1)}
    kinds = {chirps.get(index) for index in sent[:512]}  # the chip has room for 512 chirps
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind is None or any(kind[1:5]) or kind[0] not in profiles:
        raise RecordingError(
            file,
            got=f"a frame of chirps {sent.start} to {sent.stop - 1} that differ or are not set",
            need="a frame of equal chirps from the same transmitters",
            fix="Record with one kind of chirp; transmitters that take turns are not read yet.",
        )
    return profiles[kind[0]]


def _chirp(chip: str, profile: Call) -> Chirp:
    _, start, _, adc_start, ramp_end, _, _, slope, _, n_samples, sample_rate_khz = profile[:11]
    reference_hz = _REFERENCE_60_HZ if "68" in chip else _REFERENCE_77_HZ
    return Chirp(
        start_frequency_hz=start * reference_hz / 2**26,
        slope_hz_per_s=slope * reference_hz * 900e6 / 2**26,
        adc_start_s=adc_start * _TIME_S,
        ramp_duration_s=ramp_end * _TIME_S,
        sample_rate_hz=sample_rate_khz * 1e3,
        n_samples=n_samples,
        sampling="complex",
    )


def _one_chirp_a_frame(n_frames: int, period_s: float) -> Finding:
    return Finding(
        level="note",
        setting="radar.frame.n_chirps",
        got=f"{n_frames} frames of one chirp, read as one frame of {n_frames} chirps,"
        f" {period_s * 1e3:g} ms apart",
        need="several chirps in a frame, to measure velocity",
        fix="Give the radar with another number of chirps to divide them otherwise.",
    )
