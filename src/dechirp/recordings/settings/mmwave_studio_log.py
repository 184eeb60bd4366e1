"""TI mmWave Studio: the log of the calls that set up the radar (`LogFile.txt`)."""

import re
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import (
    FREQUENCY_STEP_60_HZ,
    FREQUENCY_STEP_77_HZ,
    SLOPE_STEP_60_HZ_PER_S,
    SLOPE_STEP_77_HZ_PER_S,
)
from dechirp.recordings.settings.base import RecordingSettings, convert_setting_errors
from dechirp.recordings.settings.ti_frame import (
    BITS,
    CHIRP_PHASES,
    MAX_CHIRPS,
    TiFrame,
    ti_frame_to_recording_settings,
)

_CALL = re.compile(r"API:(\w+),(.*)")

# Divisors, because a product with 1e-8 is not the nearest float to 60 us.
_TIMES_PER_S = 1e8
_PERIODS_PER_S = 2e8

_REQUIRED_CALLS = {
    "ChannelConfig": 2,
    "DataFmtConfig": 5,
    "ProfileConfig": 11,
    "ChirpConfig": 8,
    "FrameConfig": 5,
}
"""Calls that must occur, and the minimum number of their arguments."""

_MAX_NUMBER = 2**32  # of a number in a call; larger numbers are damaged

Call = tuple[int, ...]


def is_mmwave_studio_log(text: str) -> bool:
    """Return whether a text is such a log."""
    return "API:ProfileConfig," in text


def read_mmwave_studio_log(
    file: Path, text: str, device: Device | None = None
) -> RecordingSettings:
    """Read the settings that were valid when the sensor was last started.

    A frame of one chirp has no slow time. Consecutive frames of one chirp are merged into one
    frame, with a finding. The device is the given one, else the chip that the log names.

    Raises
    ------
    RecordingError
        If a call is missing or invalid, the chirps of a frame differ in more than their
        transmitters, or several transmitters send at once with phases of their own.
    """
    chip, calls = _parse_chip_name_and_calls(file, text)
    profiles = {call[0]: call for call in calls["ProfileConfig"]}
    channel, layout, frame = (
        calls[name][-1] for name in ("ChannelConfig", "DataFmtConfig", "FrameConfig")
    )
    _, bits, form, iq_swap, interleave = layout[:5]
    if bits not in BITS or form not in (0, 1, 2) or {iq_swap, interleave} - {0, 1}:
        raise RecordingError(
            file,
            value=f"DataFmtConfig with bits {bits}, format {form}, iqSwap {iq_swap},"
            f" chInterleave {interleave}",
            expected="bits 0 to 2, format 0 (real), 1 or 2 (complex), iqSwap and chInterleave 0"
            " or 1",
            fix="record so; other layouts are not supported yet",
        )
    first, last, n_frames, n_loops, period = frame[:5]
    profile, masks = _find_profile_and_transmitters(
        file, calls["ChirpConfig"], profiles, range(first, last + 1)
    )
    if any(mask.bit_count() > 1 for mask in masks):
        _refuse_phases_of_chirps(file, text)
    with convert_setting_errors(file):
        ti_frame = TiFrame(
            chirp=_profile_to_chirp(chip, profile, is_real_sampling=form == 0),
            interval_s=(profile[2] + profile[4]) / _TIMES_PER_S,
            masks=masks,
            n_loops=n_loops,
            n_frames=n_frames,
            period_s=period / _PERIODS_PER_S,
            rx_mask=channel[1],
        )
        return ti_frame_to_recording_settings(
            ti_frame,
            iq="qi" if iq_swap else "iq",
            interleaved=interleave == 0,
            bits=BITS[bits],
            chip_name=chip,
            device=device,
        )


def _refuse_phases_of_chirps(file: Path, text: str) -> None:
    """Raise `RecordingError` if a log sets the phases of transmitters chirp by chirp."""
    calls = (_CALL.search(line) for line in text.splitlines() if "API:" in line)
    names = [call[1] for call in calls if call and CHIRP_PHASES.search(call[1])]
    if names:
        raise RecordingError(
            file,
            value=f"chirps of several transmitters, with calls of {names[0]}",
            expected="one transmitter in each chirp, or equal phases of all in every chirp",
            fix="give the .mmwave.json file of the capture, or the radar as a YAML file with its"
            " multiplexing",
        )


def _parse_chip_name_and_calls(file: Path, text: str) -> tuple[str, dict[str, list[Call]]]:
    """Return the name of the chip, and the calls before the last start, by name and in order."""
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if "API:SensorStart," in line]
    chip = ""
    calls: dict[str, list[Call]] = {name: [] for name in _REQUIRED_CALLS}
    for number, line in enumerate(lines[: starts[-1]] if starts else lines, start=1):
        call = _CALL.search(line) if "API:" in line else None
        if call is None:
            continue
        name, rest = call.groups()
        if name == "select_chip_version":
            chip = rest.split(",")[0]
        elif name in calls:
            calls[name].append(_parse_call_arguments(file, number, name, rest))
    missing = [name for name, matching_calls in calls.items() if not matching_calls]
    if missing:
        raise RecordingError(
            file,
            value=f"no {', '.join(missing)} in the log",
            expected="all calls that set up the radar",
            fix="use the whole log, from the first call to SensorStart",
        )
    return chip, calls


def _parse_call_arguments(file: Path, line: int, name: str, text: str) -> Call:
    """Parse the arguments of a call."""
    try:
        numbers = tuple(int(word) for word in text.strip().rstrip(",").split(","))
    except ValueError:
        numbers = ()
    if len(numbers) < _REQUIRED_CALLS[name] or max(map(abs, numbers)) > _MAX_NUMBER:
        raise RecordingError(
            file,
            value=f"{name} with {text.strip()[:60]!r} in line {line}",
            expected=f"{name} with at least {_REQUIRED_CALLS[name]} integers of up to 32 bits",
            fix="use the unchanged log of mmWave Studio",
        )
    return numbers


def _find_profile_and_transmitters(
    file: Path, calls: list[Call], profiles: dict[int, Call], chirp_indices: range
) -> tuple[Call, tuple[int, ...]]:
    """Return the common profile of the chirps of the frame, and the transmitters of each chirp."""
    # Profile, then the changes to it, then a mask of the transmitters: a bit each, as in
    # ChannelConfig. The 0 at the end of each line is the status of the call.
    # Only the last call for the same chirps counts; a log may repeat them for years.
    latest: dict[tuple[int, int], Call] = {}
    for call in calls:
        span = (max(call[0], 0), min(call[1], MAX_CHIRPS - 1))
        latest.pop(span, None)
        latest[span] = call[2:]
    chirps = {index: kind for (low, high), kind in latest.items() for index in range(low, high + 1)}
    used_chirps = [chirps.get(index) for index in chirp_indices[: MAX_CHIRPS + 1]]
    kinds = {chirp and chirp[:5] for chirp in used_chirps}
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind is None or any(kind[1:]) or kind[0] not in profiles:
        raise RecordingError(
            file,
            value=f"chirps {chirp_indices.start} to {chirp_indices.stop - 1} of the frame, which"
            " differ or are not set",
            expected="equal chirps, of any transmitters in turn",
            fix="record equal chirps; others are not supported yet",
        )
    return profiles[kind[0]], tuple(chirp[5] for chirp in used_chirps if chirp)


def _profile_to_chirp(chip: str, profile: Call, *, is_real_sampling: bool) -> Chirp:
    """Convert a profile to a chirp."""
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
        sampling="real" if is_real_sampling else "complex",
    )
