"""TI mmWave Studio: the log of the calls that set the radar up (`LogFile.txt`)."""

import re
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.formats.settings.base import Settings, values_from
from dechirp.formats.settings.ti_frame import BITS, MOST_CHIRPS, TiFrame, ti_settings
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import (
    FREQUENCY_STEP_60_HZ,
    FREQUENCY_STEP_77_HZ,
    SLOPE_STEP_60_HZ_PER_S,
    SLOPE_STEP_77_HZ_PER_S,
)

_CALL = re.compile(r"API:(\w+),(.*)")

# Numbers are divided: a product with 1e-8 is not the nearest float to 60 us.
_TIMES_PER_S = 1e8
_PERIODS_PER_S = 2e8

_NEEDED = {
    "ChannelConfig": 2,
    "DataFmtConfig": 5,
    "ProfileConfig": 11,
    "ChirpConfig": 8,
    "FrameConfig": 5,
}
"""Calls that must have been made, and how many numbers each must give."""

_LARGEST = 2**32  # of a number in a call; larger ones are damage

Call = tuple[int, ...]


def looks_like(text: str) -> bool:
    """Whether a text is such a log."""
    return "API:ProfileConfig," in text


def read(file: Path, text: str, device: Device | None = None) -> Settings:
    """Read the settings that held when the sensor was started last.

    A frame of one chirp has no slow time. Such frames, sent one after the other, are
    taken as the chirps of one frame, and a finding says so. The device is the one that is
    given, else the chip that the log names.

    Raises
    ------
    RecordingError
        If a call is missing or not understood, the chirps of a frame differ in more than
        who sends them, or several transmitters send at once.
    """
    chip, calls = _calls(file, text)
    profiles = {call[0]: call for call in calls["ProfileConfig"]}
    channel, layout, frame = (
        calls[name][-1] for name in ("ChannelConfig", "DataFmtConfig", "FrameConfig")
    )
    _, bits, form, iq_swap, interleave = layout[:5]
    if bits not in BITS or form not in (0, 1, 2) or {iq_swap, interleave} - {0, 1}:
        raise RecordingError(
            file,
            got=f"DataFmtConfig with bits {bits}, format {form}, iqSwap {iq_swap},"
            f" chInterleave {interleave}",
            need="bits 0 to 2, real or complex samples (0; 1 or 2), iqSwap and chInterleave 0 or 1",
            fix="Record it so; other layouts are not read yet.",
        )
    first, last, n_frames, n_loops, period = frame[:5]
    profile, masks = _one_profile(file, calls["ChirpConfig"], profiles, range(first, last + 1))
    with values_from(file):
        sent = TiFrame(
            chirp=_chirp(chip, profile, real=form == 0),
            interval_s=(profile[2] + profile[4]) / _TIMES_PER_S,
            masks=masks,
            n_loops=n_loops,
            n_frames=n_frames,
            period_s=period / _PERIODS_PER_S,
            rx_mask=channel[1],
        )
        return ti_settings(
            sent,
            iq="qi" if iq_swap else "iq",
            interleaved=interleave == 0,
            bits=BITS[bits],
            named=chip,
            device=device,
        )


def _calls(file: Path, text: str) -> tuple[str, dict[str, list[Call]]]:
    """Name of the chip, and the calls made before the last start, by name and in order."""
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if "API:SensorStart," in line]
    chip = ""
    calls: dict[str, list[Call]] = {name: [] for name in _NEEDED}
    for number, line in enumerate(lines[: starts[-1]] if starts else lines, start=1):
        call = _CALL.search(line) if "API:" in line else None
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
    if len(numbers) < _NEEDED[name] or max(map(abs, numbers)) > _LARGEST:
        raise RecordingError(
            file,
            got=f"{name} with {text.strip()[:60]!r} in line {line}",
            need=f"{name} with at least {_NEEDED[name]} whole numbers of up to 32 bits",
            fix="Take the log as mmWave Studio wrote it.",
        )
    return numbers


def _one_profile(
    file: Path, made: list[Call], profiles: dict[int, Call], sent: range
) -> tuple[Call, tuple[int, ...]]:
    """Give the profile of all chirps of the frame, and the transmitters of each."""
    # Profile, then the changes to it, then a mask of the transmitters: a bit each, as in
    # ChannelConfig. A 0 ends every line: it is the call's status.
    # Of calls for the same chirps only the last counts: a log may repeat them for years.
    latest: dict[tuple[int, int], Call] = {}
    for call in made:
        span = (max(call[0], 0), min(call[1], MOST_CHIRPS - 1))
        latest.pop(span, None)
        latest[span] = call[2:]
    chirps = {index: kind for (low, high), kind in latest.items() for index in range(low, high + 1)}
    used = [chirps.get(index) for index in sent[: MOST_CHIRPS + 1]]
    kinds = {chirp and chirp[:5] for chirp in used}
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind is None or any(kind[1:]) or kind[0] not in profiles:
        raise RecordingError(
            file,
            got=f"a frame of chirps {sent.start} to {sent.stop - 1} that differ or are not set",
            need="a frame of equal chirps, of any transmitters in turn",
            fix="Record with one kind of chirp; others are not read yet.",
        )
    return profiles[kind[0]], tuple(chirp[5] for chirp in used if chirp)


def _chirp(chip: str, profile: Call, *, real: bool) -> Chirp:
    _, start, _, adc_start, ramp_end, _, _, slope, _, n_samples, sample_rate_khz = profile[:11]
    at_60_ghz = "68" in chip
    start_step_hz = FREQUENCY_STEP_60_HZ if at_60_ghz else FREQUENCY_STEP_77_HZ
    slope_step = SLOPE_STEP_60_HZ_PER_S if at_60_ghz else SLOPE_STEP_77_HZ_PER_S
    return Chirp(
        start_frequency_hz=start * start_step_hz,
        slope_hz_per_s=slope * slope_step,
        adc_start_s=adc_start / _TIMES_PER_S,
        ramp_duration_s=ramp_end / _TIMES_PER_S,
        sample_rate_hz=sample_rate_khz * 1e3,
        n_samples=n_samples,
        sampling="real" if real else "complex",
    )
