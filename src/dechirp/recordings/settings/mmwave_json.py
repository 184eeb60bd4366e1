"""TI mmWave Studio: the settings sent to the radar (`.mmwave.json`).

Several chips form a cascade, in the order of the file: their antennas are numbered consecutively,
and the waveform is that of the first.

Some programs that rewrite these files turn each list of one item into that item.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.recordings.settings.base import RecordingSettings, convert_setting_errors
from dechirp.recordings.settings.json_text import (
    format_json_excerpt,
    is_float_sized_number,
    parse_json,
)
from dechirp.recordings.settings.ti_frame import (
    BITS,
    MAX_CHIRPS,
    TiFrame,
    ti_frame_to_recording_settings,
)

_TX, _RX = 3, 4  # antennas of each chip of a cascade

_CHANNELS = ("rxChannelEn",)
_CODES = ("b2AdcBits", "b2AdcOutFmt")
_LAYOUT = ("iqSwapSel", "chInterleave")
_PROFILE = (
    "profileId",
    "startFreqConst_GHz",
    "idleTimeConst_usec",
    "adcStartTimeConst_usec",
    "rampEndTime_usec",
    "freqSlopeConst_MHz_usec",
    "numAdcSamples",
    "digOutSampleRate",
)
_VARIATIONS = (
    "startFreqVar_MHz",
    "freqSlopeVar_KHz_usec",
    "idleTimeVar_usec",
    "adcStartTimeVar_usec",
)
_CHIRP = ("chirpStartIdx", "chirpEndIdx", "profileId", *_VARIATIONS, "txEnable")
_FRAME = ("chirpStartIdx", "chirpEndIdx", "numLoops", "numFrames", "framePeriodicity_msec")
_SEQUENCE = ("numOfSubFrames", "forceProfile", "numFrames")
_SUB_FRAME = (
    "chirpStartIdx",
    "numOfChirps",
    "numLoops",
    "numOfBurst",
    "numOfBurstLoops",
    "subFramePeriodicity_msec",
)
_BPM_CHIRP = ("chirpStartIdx", "chirpEndIdx", "constBpmVal")
_FRACTIONS = ("_GHz", "_usec", "_MHz", "_msec")
"""Endings of keys whose numbers may have a fraction."""

_SUPPORTED_VALUES = {
    "b2AdcBits": tuple(BITS),
    "b2AdcOutFmt": (0, 1, 2),
    "iqSwapSel": (0, 1),
    "chInterleave": (0, 1),
    "numOfSubFrames": (1,),
    "forceProfile": (0,),
    "numOfBurst": (1,),
    "numOfBurstLoops": (1,),
}
"""Supported values of keys that accept more."""

Numbers = dict[str, float]


def is_mmwave_json(text: str) -> bool:
    """Return whether a text is such a file, provided that it is JSON."""
    return '"mmWaveDevices"' in text


def read_mmwave_json(
    file: Path, text: str, device: Device | None = None, chip_name: str = ""
) -> RecordingSettings:
    """Read the settings.

    Parameters
    ----------
    file, text
        The file, and its text.
    device : Device, optional
        Device given by the user, which has priority over the name.
    chip_name : str
        Name of the chip, which this file does not contain.

    Raises
    ------
    RecordingError
        If it is not JSON; if keys are missing, of the wrong type or unsupported, all of them named;
        if chirps of the frame differ in more than their transmitters and signs, or these do not
        separate the transmitters.
    """
    document = parse_json(file, text)
    chips = _list_at_key_path(document, "mmWaveDevices")
    if not 1 <= len(chips) <= 4:
        raise RecordingError(
            file,
            value="no list mmWaveDevices of one to four chips",
            expected="a .mmwave.json file of mmWave Studio",
            fix="copy the file again from its source, or give the radar",
        )
    problems: list[str] = []
    chip_settings = [
        _parse_chip_settings(chip, f"mmWaveDevices[{n}]", problems) for n, chip in enumerate(chips)
    ]
    if problems:
        more = f" and {len(problems) - 8} more" if len(problems) > 8 else ""
        raise RecordingError(
            file,
            value=f"{', '.join(problems[:8])}{more}",
            expected="numbers as mmWave Studio writes them (decimal or 0x..), for one frame of"
            " equal chirps",
            fix="record so, or give the radar; other settings are not supported yet",
        )
    first = chip_settings[0]
    profile, masks, inverted_masks = _find_profile_and_transmitters(file, chip_settings)
    with convert_setting_errors(file):
        ti_frame = TiFrame(
            chirp=_profile_to_chirp(profile, is_real_sampling=first.codes["b2AdcOutFmt"] == 0),
            interval_s=(profile["idleTimeConst_usec"] + profile["rampEndTime_usec"]) / 1e6,
            masks=masks,
            inverted_masks=inverted_masks,
            n_loops=int(first.frame["numLoops"]),
            n_frames=int(first.frame["numFrames"]),
            period_s=first.frame_period_ms / 1e3,
            rx_mask=_join_antenna_masks(
                [int(chip.codes["rxChannelEn"]) for chip in chip_settings], _RX
            ),
        )
        return ti_frame_to_recording_settings(
            ti_frame,
            iq="qi" if first.codes["iqSwapSel"] else "iq",
            interleaved=not first.codes["chInterleave"],
            bits=BITS[int(first.codes["b2AdcBits"])],
            chip_name=chip_name if len(chip_settings) == 1 else "cascade",
            device=device,
        )


@frozen_dataclass
class _Chip:
    """Settings of one chip, by the keys of the file."""

    codes: Numbers
    profiles: Sequence[Numbers]
    chirps: Sequence[Numbers]
    bpm_chirps: Sequence[Numbers]
    """Signs of the transmitters in some chirps."""
    frame: Numbers

    @property
    def loop_chirp_indices(self) -> range:
        """Chirp indices of a loop."""
        first = int(self.frame["chirpStartIdx"])
        if "numOfChirps" in self.frame:
            return range(first, first + int(self.frame["numOfChirps"]))
        return range(first, int(self.frame["chirpEndIdx"]) + 1)

    @property
    def frame_period_ms(self) -> float:
        """Frame period; a frame has one sub-frame."""
        in_sub_frames = "subFramePeriodicity_msec" in self.frame
        return self.frame["subFramePeriodicity_msec" if in_sub_frames else "framePeriodicity_msec"]


def _parse_chip_settings(chip: Any, json_path: str, problems: list[str]) -> _Chip:
    """Read the numbers of a chip; append errors to `problems`."""

    def read_object(key_path: str, keys: tuple[str, ...]) -> Numbers:
        return _read_numbers_of_keys(
            _value_at_key_path(chip, key_path), f"{json_path}.{key_path}", keys, problems
        )

    def read_each(key_path: str, keys: tuple[str, ...]) -> list[Numbers]:
        parts = enumerate(_list_at_key_path(chip, key_path))
        return [
            _read_numbers_of_keys(part, f"{json_path}.{key_path}[{n}]", keys, problems)
            for n, part in parts
        ]

    radio = "rfConfig"
    codes = read_object(f"{radio}.rlChanCfg_t", _CHANNELS)
    codes |= read_object(f"{radio}.rlAdcOutCfg_t.fmt", _CODES)
    codes |= read_object("rawDataCaptureConfig.rlDevDataFmtCfg_t", _LAYOUT)
    advanced = f"{radio}.rlAdvFrameCfg_t.frameSeq"
    in_sub_frames = _value_at_key_path(chip, f"{radio}.waveformType") == "advancedFrameChirp"
    in_sub_frames = in_sub_frames or _value_at_key_path(chip, f"{radio}.rlFrameCfg_t") is None
    if in_sub_frames and _value_at_key_path(chip, advanced) is not None:
        frame = read_object(advanced, _SEQUENCE)
        # The file always lists four sub-frames, of which `numOfSubFrames` are in use.
        first = [*_list_at_key_path(chip, f"{advanced}.subFrameCfg"), None][0]
        frame |= _read_numbers_of_keys(
            first, f"{json_path}.{advanced}.subFrameCfg[0]", _SUB_FRAME, problems
        )
    else:
        frame = read_object(f"{radio}.rlFrameCfg_t", _FRAME)
    for key_path in ("rlRfPhaseShiftCfgs", "rlDynPerChirpPhShftCfgs"):
        if any(map(_has_phase_shift, _list_at_key_path(chip, f"{radio}.{key_path}"))):
            problems.append(
                f"{json_path}.{radio}.{key_path} (phases that change from chirp to chirp)"
            )
    return _Chip(
        codes=codes,
        profiles=read_each(f"{radio}.rlProfiles", _PROFILE),
        chirps=read_each(f"{radio}.rlChirps", _CHIRP),
        bpm_chirps=read_each(f"{radio}.rlBpmChirps", _BPM_CHIRP),
        frame=frame,
    )


def _find_profile_and_transmitters(
    file: Path, chips: Sequence[_Chip]
) -> tuple[Numbers, tuple[int, ...], tuple[int, ...]]:
    """Return the common profile of the chirps of the frame, and two masks of each chirp.

    The first contains its transmitters, the second those of them with the opposite sign.
    """
    first = chips[0]
    profiles = {profile["profileId"]: profile for profile in first.profiles}
    indices = first.loop_chirp_indices
    loop = indices[:MAX_CHIRPS]
    chirps_by_index = [[_settings_at(chip.chirps, index) for chip in chips] for index in loop]
    chirps = [[chirp for chirp in simultaneous if chirp] for simultaneous in chirps_by_index]
    used = {chirp["profileId"] for simultaneous in chirps for chirp in simultaneous[:1]}
    are_equal = len(used) == 1 and not any(
        chirp[key] for simultaneous in chirps for chirp in simultaneous for key in _VARIATIONS
    )
    are_complete = 0 <= indices.start < indices.stop <= MAX_CHIRPS
    are_complete = are_complete and all(len(simultaneous) == len(chips) for simultaneous in chirps)
    if not (are_equal and are_complete and used <= profiles.keys()):
        raise RecordingError(
            file,
            value=f"chirps {indices.start} to {indices.stop - 1} of the frame,"
            " which differ or are not set",
            expected="equal chirps, of any transmitters in turn",
            fix="record equal chirps; others are not supported yet",
        )
    masks = tuple(
        _join_antenna_masks([int(chirp["txEnable"]) for chirp in simultaneous], _TX)
        for simultaneous in chirps
    )
    inverted_masks = tuple(
        mask
        & _join_antenna_masks(
            [_inverted_mask(_settings_at(chip.bpm_chirps, index)) for chip in chips], _TX
        )
        for index, mask in zip(loop, masks, strict=True)
    )
    return profiles[used.pop()], masks, inverted_masks


def _inverted_mask(bpm_chirp: Numbers | None) -> int:
    """Return the transmitters that a chirp inverts, a bit each.

    `constBpmVal` has two bits a transmitter, of which the upper one is valid during the chirp
    (`rlBpmChirpCfg_t`, rl_sensor.h of mmWave SDK 3.5).
    """
    code = 0 if bpm_chirp is None else int(bpm_chirp["constBpmVal"])
    return sum((code >> 2 * n + 1 & 1) << n for n in range(_TX))


def _settings_at(chirps: Sequence[Numbers], chirp_index: int) -> Numbers | None:
    """Return the setting of a chirp index, the last of several; None without one."""
    chirps = [
        chirp for chirp in chirps if chirp["chirpStartIdx"] <= chirp_index <= chirp["chirpEndIdx"]
    ]
    return chirps[-1] if chirps else None


def _join_antenna_masks(masks: Sequence[int], antennas_per_chip: int) -> int:
    """Join the antenna masks of several chips; a single chip may have any number of antennas."""
    if len(masks) > 1 and any(mask >> antennas_per_chip for mask in masks):
        return 0  # an empty mask, which its user rejects
    return sum(mask << n * antennas_per_chip for n, mask in enumerate(masks))


def _profile_to_chirp(profile: Numbers, *, is_real_sampling: bool) -> Chirp:
    """Convert a profile to a chirp."""
    return Chirp(
        start_frequency_hz=profile["startFreqConst_GHz"] * 1e9,
        slope_hz_per_s=profile["freqSlopeConst_MHz_usec"] * 1e12,
        adc_start_s=profile["adcStartTimeConst_usec"] / 1e6,
        ramp_duration_s=profile["rampEndTime_usec"] / 1e6,
        sample_rate_hz=profile["digOutSampleRate"] * 1e3,
        n_samples=int(profile["numAdcSamples"]),
        sampling="real" if is_real_sampling else "complex",
    )


def _value_at_key_path(document: Any, key_path: str) -> Any:
    """Return the value at a path of keys; None if there is none."""
    for key in key_path.split("."):
        document = document.get(key) if isinstance(document, dict) else None
    return document


def _list_at_key_path(document: Any, key_path: str) -> list[Any]:
    """Return the items of the list at a path; unwrap items that are objects of a single key.

    An object in place of the list is its only item, and one that is empty an empty list.
    """
    parts = _value_at_key_path(document, key_path)
    if isinstance(parts, dict):
        parts = [parts] if parts else []
    return [
        next(iter(part.values())) if isinstance(part, dict) and len(part) == 1 else part
        for part in (parts if isinstance(parts, list) else [])
    ]


def _read_numbers_of_keys(
    document: Any, json_path: str, keys: Sequence[str], problems: list[str]
) -> Numbers:
    """Read the numbers of some keys; append errors to `problems`."""
    if not isinstance(document, dict):
        problems.append(f"{json_path} missing")
        return dict.fromkeys(keys, 0)
    numbers = {
        key: _parse_number(document.get(key), must_be_integer=not key.endswith(_FRACTIONS))
        for key in keys
    }
    for key, number in numbers.items():
        if key not in document:
            problems.append(f"{json_path}.{key} missing")
        elif number is None or number not in _SUPPORTED_VALUES.get(key, (number,)):
            problems.append(f"{json_path}.{key} = {format_json_excerpt(document[key])}")
    return {key: number or 0 for key, number in numbers.items()}


def _parse_number(value: Any, *, must_be_integer: bool) -> float | None:
    """Return a number, also from text in decimal or hexadecimal; None if it is invalid."""
    if isinstance(value, str) and len(value) <= 40 and value.isascii():
        try:
            value = int(value, 16) if value.lower().startswith("0x") else float(value)
        except ValueError:
            return None
    # No number of these files is larger; the comparison also excludes NaN.
    is_valid = (
        is_float_sized_number(value) and abs(value) <= 1e9 and not (must_be_integer and value % 1)
    )
    return float(value) if is_valid else None


def _has_phase_shift(phase_settings: Any) -> bool:
    """Return whether a phase setting is not zero."""
    phases = phase_settings.items() if isinstance(phase_settings, dict) else ()
    return any(
        "PhaseShift" in key and _parse_number(phase, must_be_integer=False) != 0
        for key, phase in phases
    )
