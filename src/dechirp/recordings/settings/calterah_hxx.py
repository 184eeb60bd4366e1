"""Calterah's sensor settings, `sensor_config_init0.hxx`: one profile of a radar.

Units are GHz, MHz and us, antenna positions are in wavelengths: four receivers for each of the
transmitters. The file contains no multiplexing by phase.
"""

import json
import re
from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.base import RecordingSettings, convert_setting_errors

_MARK = ".fmcw_startfreq"
_LINE = re.compile(r"^\s*\.(\w+)\s*=\s*(.*?),?\s*$", re.MULTILINE)
_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_N_RX = 4


@frozen_dataclass
class CalterahProfile:
    """Settings of one profile, without multiplexing."""

    path: Path
    frame: Frame
    """All chirps of a frame."""
    array: Array
    """All transmitters."""

    @property
    def n_words(self) -> int:
        """Number of words of a frame of one receiver, two samples each."""
        return self.frame.n_chirps * self.frame.chirp.n_samples // 2


def is_calterah_hxx(text: str) -> bool:
    """Return whether a text contains Calterah's sensor settings."""
    return _MARK in text


def read_calterah_hxx(file: Path, text: str) -> RecordingSettings:
    """Read the radar of a profile, with its first transmitter."""
    profile = read_calterah_profile(file, text)
    array = Array(tx_m=profile.array.tx_m[:1], rx_m=profile.array.rx_m)
    with convert_setting_errors(file):
        return RecordingSettings(radar=Radar(frame=profile.frame, array=array), path=file)


def read_calterah_profile(file: Path, text: str) -> CalterahProfile:
    """Read a profile; raise `RecordingError` if a setting is missing or impossible."""
    entries = dict(_LINE.findall(_COMMENT.sub("", text)))
    numbers = {
        name: _number(file, entries, name)
        for name in (
            *("fmcw_startfreq", "fmcw_bandwidth", "fmcw_chirp_rampup", "fmcw_chirp_period"),
            *("nchirp", "adc_freq", "dec_factor", "adc_sample_start", "rng_nfft"),
        )
    }
    positions = _antenna_positions(file, entries)
    with convert_setting_errors(file):
        ramp_s = numbers["fmcw_chirp_rampup"] * 1e-6
        chirp = Chirp(
            start_frequency_hz=numbers["fmcw_startfreq"] * 1e9,
            slope_hz_per_s=numbers["fmcw_bandwidth"] * 1e6 / ramp_s,
            ramp_duration_s=ramp_s,
            adc_start_s=numbers["adc_sample_start"] * 1e-6,
            sample_rate_hz=numbers["adc_freq"] * 1e6 / numbers["dec_factor"],
            n_samples=_whole_number(file, numbers, "rng_nfft"),
            sampling="real",
        )
        frame = Frame(
            chirp=chirp,
            n_chirps=_whole_number(file, numbers, "nchirp"),
            interval_s=numbers["fmcw_chirp_period"] * 1e-6,
        )
        antennas_m = [(0.0, y * chirp.wavelength_m, z * chirp.wavelength_m) for y, z in positions]
        array = Array(tx_m=tuple(antennas_m[::_N_RX]), rx_m=tuple(antennas_m[:_N_RX]))
    return CalterahProfile(path=file, frame=frame, array=array)


def _number(file: Path, entries: dict[str, str], name: str) -> float:
    try:
        number = float(entries[name])
    except (KeyError, ValueError):
        number = -1.0
    if not 0 < number < 1e6:
        raise RecordingError(
            file,
            value=f"{name} {entries.get(name, 'missing')[:40]!r}",
            expected=f"a positive number as .{name}",
            fix="copy the file again from its source, or correct it",
        )
    return number


def _whole_number(file: Path, numbers: dict[str, float], name: str) -> int:
    number = numbers[name]
    if number != int(number) or number > 2**16 or number % 2:
        raise RecordingError(
            file,
            value=f"{name} {number:g}",
            expected="an even number up to 65536",
            fix="copy the file again from its source, or correct it",
        )
    return int(number)


def _antenna_positions(file: Path, entries: dict[str, str]) -> list[tuple[float, float]]:
    text = entries.get("ant_pos", "")
    try:
        rows: Any = json.loads(text.replace("{", "[").replace("}", "]"))
        positions = [(float(y), float(z)) for y, z in rows]
        is_valid = len(positions) >= _N_RX and len(positions) % _N_RX == 0
    except (ValueError, TypeError, RecursionError, OverflowError):
        is_valid = False
    if not is_valid or not all(abs(number) < 1e3 for pair in positions for number in pair):
        raise RecordingError(
            file,
            value=f"ant_pos {text[:60]!r}",
            expected="a pair of wavelengths for each of the four receivers and all transmitters",
            fix="copy the file again from its source, or correct it",
        )
    return positions
