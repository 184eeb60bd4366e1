"""Infineon: the `config.json` that the recording software writes beside the samples."""

import json
from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError
from dechirp.formats.settings.base import Settings, values_from
from dechirp.formats.settings.receivers import assumed, assumed_line
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
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


def read(file: Path, text: str) -> Settings:
    """Read the settings of the recording.

    The ramp from start to end frequency is the sampled one: it lasts N / fs.

    Raises
    ------
    RecordingError
        If it is not JSON, or keys are missing or of the wrong type, all of them named.
    """
    shape = _shape(file, _parsed(file, text))
    n_samples, sample_rate_hz = shape["num_samples_per_chirp"], float(shape["sample_rate_Hz"])
    if shape.get("mimo_mode", "off") != "off":
        raise RecordingError(
            file,
            got=f"a recording with mimo_mode {shape['mimo_mode']!r}",
            need="one with mimo_mode 'off'",
            fix="Record with one transmitter; transmitters that take turns are not read yet.",
        )
    n_rx = len(shape["rx_antennas"])
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
        )
        radar = Radar(frame=frame, array=assumed_line(chirp, n_rx))
    return Settings(radar=radar, findings=(assumed(n_rx),) if n_rx > 1 else ())


def _parsed(file: Path, text: str) -> Any:
    try:
        return json.loads(text)
    except RecursionError:
        got = "nested too deeply"
    except ValueError as error:
        got = f"not JSON ({error})"
    raise RecordingError(
        file, got=got, need="the JSON file of the recording", fix="Copy it again from its source."
    ) from None


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
        f"{key} = {json.dumps(shape[key])[:40]}"
        for keys, fits in ((_COUNTS, _count), (_NUMBERS, _number), (_LISTS, _filled_list))
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


def _number(thing: Any) -> bool:
    # Larger ones, as whole numbers, would not even fit into a float.
    return isinstance(thing, int | float) and not isinstance(thing, bool) and abs(thing) < 1e300


def _count(thing: Any) -> bool:
    return isinstance(thing, int) and _number(thing)


def _filled_list(thing: Any) -> bool:
    return isinstance(thing, list) and 0 < len(thing) <= 64
