"""Infineon: the `config.json` that the recording software writes beside the samples."""

from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError
from dechirp.formats.settings.base import Settings, values_from
from dechirp.formats.settings.json_text import count, number, parsed, shown
from dechirp.formats.settings.receivers import antennas
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar

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
_OFF, _TDM = ("off", 0), ("tdm", 1)  # mimo_mode, as words or numbers


def looks_like(text: str) -> bool:
    """Whether a text is such a file, if it is JSON at all."""
    return '"device_config"' in text


def read(file: Path, text: str, device: Device | None = None) -> Settings:
    """Read the settings of the recording.

    The ramp from start to end frequency is the sampled one: it lasts N / fs. Where
    transmitters take turns, `num_chirps_per_frame` counts those of each of the two, and
    `chirp_repetition_time_s` runs from chirp to chirp of either.

    Raises
    ------
    RecordingError
        If it is not JSON, or keys are missing or of the wrong type, all of them named.
    """
    shape = _shape(file, parsed(file, text))
    n_samples, sample_rate_hz = shape["num_samples_per_chirp"], float(shape["sample_rate_Hz"])
    mode = shape.get("mimo_mode", "off")
    if mode not in (*_OFF, *_TDM):
        raise RecordingError(
            file,
            got=f"a recording with mimo_mode {shown(mode)}",
            need="one with mimo_mode off or tdm",
            fix="Record with one transmitter, or with two that take turns.",
        )
    take_turns = mode in _TDM
    receivers = _antennas(file, shape, "rx_antennas")
    transmitters = (1, 2) if take_turns else _antennas(file, shape, "tx_antennas")
    if len(transmitters) > 1 and not take_turns:
        raise RecordingError(
            file,
            got=f"a recording with tx_antennas {', '.join(map(str, transmitters))} at once",
            need="one with one of them, or with mimo_mode tdm",
            fix="Record so; transmitters that send together are not read yet.",
        )
    with values_from(file):
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
        array, findings = antennas(
            chirp, tx_mask=_mask(transmitters), rx_mask=_mask(receivers), of=device
        )
        radar = Radar(frame=frame, array=array)
    return Settings(
        radar=radar,
        bits=_BITS,
        receivers=tuple(antenna - 1 for antenna in receivers),
        device=None if device is None else device.kind(),
        findings=findings,
    )


def _shape(file: Path, document: Any) -> dict[str, Any]:
    shape = document
    for key in ("device_config", "fmcw_single_shape"):
        shape = shape.get(key) if isinstance(shape, dict) else None
    if not isinstance(shape, dict):
        raise RecordingError(
            file,
            got="without device_config.fmcw_single_shape",
            need="the config.json of a recording of equal chirps",
            fix="Other sequences of chirps are not read yet; else give the radar.",
        )
    missing = [key for key in (*_COUNTS, *_NUMBERS, *_LISTS) if key not in shape]
    wrong = [
        f"{key} = {shown(shape[key])}"
        for keys, fits in ((_COUNTS, count), (_NUMBERS, number), (_LISTS, _filled_list))
        for key in keys
        if key in shape and not fits(shape[key])
    ]
    if missing or wrong:
        parts = [f"without {', '.join(missing)}"] * bool(missing)
        parts += [f"with {', '.join(wrong)}"] * bool(wrong)
        raise RecordingError(
            file,
            got=" and ".join(parts),
            need=f"with whole numbers {', '.join(_COUNTS)}, numbers {', '.join(_NUMBERS)} and"
            f" a list {', '.join(_LISTS)}",
            fix="Copy the file again from its source, or give the radar.",
        )
    return shape


def _filled_list(thing: Any) -> bool:
    return isinstance(thing, list) and 0 < len(thing) <= 64


def _antennas(file: Path, shape: dict[str, Any], key: str) -> tuple[int, ...]:
    """Numbers of antennas, counted from 1; the first where the file does not say."""
    listed = shape.get(key, [1])
    known = isinstance(listed, list) and all(count(one) and 1 <= one <= 16 for one in listed)
    if not known or not listed or len(set(listed)) < len(listed):
        raise RecordingError(
            file,
            got=f"with {key} = {shown(listed)} of other things",
            need=f"with a list {key} of different antennas, counted from 1",
            fix="Copy the file again from its source, or give the radar.",
        )
    return tuple(sorted(listed))


def _mask(antennas_used: tuple[int, ...]) -> int:
    return sum(1 << antenna - 1 for antenna in antennas_used)
