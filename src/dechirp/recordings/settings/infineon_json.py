"""Infineon settings: the `config.json` that the recording software writes beside the samples."""

import json
from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.antenna_positions import (
    device_or_assumed_array,
    find_device_or_none,
)
from dechirp.recordings.settings.base import RecordingSettings, convert_setting_errors
from dechirp.recordings.settings.json_text import (
    format_json_excerpt,
    is_float_sized_number,
    is_integer,
    parse_json,
)
from dechirp.recordings.settings.mmwave_setup import is_file_not_linked_outside_folder

_COUNTS = ("num_samples_per_chirp", "num_chirps_per_frame")
_NUMBERS = (
    "start_frequency_Hz",
    "end_frequency_Hz",
    "sample_rate_Hz",
    "chirp_repetition_time_s",
    "frame_repetition_time_s",
)
_LISTS = ("rx_antennas",)
_BITS = 12
_MAX_META_BYTES = 2**16
_OFF, _TDM = ("off", 0), ("tdm", 1)  # mimo_mode, as words or numbers


def is_infineon_json(text: str) -> bool:
    """Return whether a text is such a file, provided that it is JSON."""
    return '"device_config"' in text


def read_infineon_json(file: Path, text: str, device: Device | None = None) -> RecordingSettings:
    """Read the settings of the recording.

    The ramp from start to end frequency is the sampled part and lasts N / fs. With time-multiplexed
    transmitters, `num_chirps_per_frame` counts the chirps of each of the two, and
    `chirp_repetition_time_s` is the interval between consecutive chirps of either.

    Without a given device, its antennas are those of the chip that `meta.json` names beside it.

    Raises
    ------
    RecordingError
        If it is not JSON, or keys are missing or of the wrong type; the message names all of them.
    """
    device = device or _find_recording_device(file.parent)
    shape = _read_chirp_settings(file, parse_json(file, text))
    n_samples, sample_rate_hz = shape["num_samples_per_chirp"], float(shape["sample_rate_Hz"])
    mode = shape.get("mimo_mode", "off")
    if mode not in (*_OFF, *_TDM):
        raise RecordingError(
            file,
            value=f"mimo_mode {format_json_excerpt(mode)}",
            expected="mimo_mode off or tdm",
            fix="record with one transmitter, or with two that take turns",
        )
    take_turns = mode in _TDM
    receivers = _read_antenna_numbers(file, shape, "rx_antennas")
    transmitters = (1, 2) if take_turns else _read_antenna_numbers(file, shape, "tx_antennas")
    if len(transmitters) > 1 and not take_turns:
        raise RecordingError(
            file,
            value=f"tx_antennas {', '.join(map(str, transmitters))} at once",
            expected="one of them, or mimo_mode tdm",
            fix="record so; simultaneous transmitters are not supported yet",
        )
    with convert_setting_errors(file):
        sweep_hz = shape["end_frequency_Hz"] - shape["start_frequency_Hz"]
        duration_s = n_samples / sample_rate_hz if sample_rate_hz > 0 else 0.0
        chirp = Chirp(
            start_frequency_hz=float(shape["start_frequency_Hz"]),
            slope_hz_per_s=sweep_hz / duration_s if duration_s > 0 else 0.0,
            ramp_duration_s=duration_s,
            sample_rate_hz=sample_rate_hz,
            n_samples=n_samples,
            sampling="real",
        )
        frame = Frame(
            chirp=chirp,
            n_chirps=shape["num_chirps_per_frame"],
            interval_s=float(shape["chirp_repetition_time_s"]),
            period_s=float(shape["frame_repetition_time_s"]),
            multiplexing=Tdm(order=(0, 1)) if take_turns else None,
        )
        array, findings = device_or_assumed_array(
            chirp,
            tx_mask=_antennas_to_bit_mask(transmitters),
            rx_mask=_antennas_to_bit_mask(receivers),
            device=device,
        )
        radar = Radar(frame=frame, array=array)
    return RecordingSettings(
        radar=radar,
        bits=_BITS,
        receivers=tuple(antenna - 1 for antenna in receivers),
        device=None if device is None else device.kind(),
        findings=findings,
    )


def _find_recording_device(folder: Path) -> Device | None:
    """Return the device that the recording software describes in `meta.json`; None if unknown."""
    file = folder / "meta.json"
    if not is_file_not_linked_outside_folder(file) or file.stat().st_size > _MAX_META_BYTES:
        return None
    try:
        description = json.loads(file.read_text(errors="replace"))["description"]
        return find_device_or_none(description.split()[0])  # "BGT60TR13C FMCW Radar Sensor"
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None


def _read_chirp_settings(file: Path, document: Any) -> dict[str, Any]:
    """Return the settings of the chirps; raise `RecordingError` if they are incomplete."""
    shape = document
    for key in ("device_config", "fmcw_single_shape"):
        shape = shape.get(key) if isinstance(shape, dict) else None
    if not isinstance(shape, dict):
        raise RecordingError(
            file,
            value="no device_config.fmcw_single_shape",
            expected="the config.json of a recording of equal chirps",
            fix="give the radar; other chirp sequences are not supported yet",
        )
    missing = [key for key in (*_COUNTS, *_NUMBERS, *_LISTS) if key not in shape]
    wrong = [
        f"{key} = {format_json_excerpt(shape[key])}"
        for keys, is_valid in (
            (_COUNTS, is_integer),
            (_NUMBERS, is_float_sized_number),
            (_LISTS, _is_list_of_1_to_64_items),
        )
        for key in keys
        if key in shape and not is_valid(shape[key])
    ]
    if missing or wrong:
        parts = [f"no {', '.join(missing)}"] * bool(missing)
        parts += [", ".join(wrong)] * bool(wrong)
        raise RecordingError(
            file,
            value=" and ".join(parts),
            expected=f"integers {', '.join(_COUNTS)}, numbers {', '.join(_NUMBERS)} and"
            f" a list {', '.join(_LISTS)}",
            fix="copy the file again from its source, or give the radar",
        )
    return shape


def _is_list_of_1_to_64_items(value: Any) -> bool:
    """Return whether a JSON value is a list of 1 to 64 items."""
    return isinstance(value, list) and 0 < len(value) <= 64


def _read_antenna_numbers(
    file: Path, fmcw_shape_settings: dict[str, Any], key: str
) -> tuple[int, ...]:
    """Return the numbers of antennas, from 1; the first if the key is missing."""
    numbers = fmcw_shape_settings.get(key, [1])
    is_valid = isinstance(numbers, list) and all(
        is_integer(number) and 1 <= number <= 16 for number in numbers
    )
    if not is_valid or not numbers or len(set(numbers)) < len(numbers):
        raise RecordingError(
            file,
            value=f"{key} = {format_json_excerpt(numbers)} with invalid antennas",
            expected=f"a list {key} of different antennas, counted from 1",
            fix="copy the file again from its source, or give the radar",
        )
    return tuple(sorted(numbers))


def _antennas_to_bit_mask(antennas_used: tuple[int, ...]) -> int:
    """Return the mask of antennas."""
    return sum(1 << antenna - 1 for antenna in antennas_used)
