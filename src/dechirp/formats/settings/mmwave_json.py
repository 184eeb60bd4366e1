"""TI mmWave Studio: what it told the radar (`.mmwave.json`).

Several chips are those of a cascade, in the order of the file: their antennas count on from
one to the next, and the waveform is that of the first.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.settings.base import Settings, values_from
from dechirp.formats.settings.json_text import number, parsed, shown
from dechirp.formats.settings.ti_frame import BITS, MOST_CHIRPS, TiFrame, ti_settings
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device

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
_FRACTIONS = ("_GHz", "_usec", "_MHz", "_msec")
"""Ends of keys whose numbers need not be whole."""

_READ = {
    "b2AdcBits": tuple(BITS),
    "b2AdcOutFmt": (0, 1, 2),
    "iqSwapSel": (0, 1),
    "chInterleave": (0, 1),
    "numOfSubFrames": (1,),
    "forceProfile": (0,),
    "numOfBurst": (1,),
    "numOfBurstLoops": (1,),
}
"""What is read, of all that the keys can say."""

Numbers = dict[str, float]


def looks_like(text: str) -> bool:
    """Whether a text is such a file, if it is JSON at all."""
    return '"mmWaveDevices"' in text


def read(file: Path, text: str, device: Device | None = None, named: str = "") -> Settings:
    """Read the settings.

    Parameters
    ----------
    file, text
        The file, and what it holds.
    device : Device, optional
        What the user said it is; it comes before the name.
    named : str
        Name of the chip, which this file does not give.

    Raises
    ------
    RecordingError
        If it is not JSON, keys are missing, of the wrong type or set up what is not read
        yet, all of them named; if chirps of the frame differ in more than who sends them, or
        several transmitters send at once.
    """
    document = parsed(file, text)
    chips = document.get("mmWaveDevices") if isinstance(document, dict) else None
    if not isinstance(chips, list) or not 1 <= len(chips) <= 4:
        raise RecordingError(
            file,
            got="without a list mmWaveDevices of one to four chips",
            need="the file in which mmWave Studio keeps what it told the radar",
            fix="Copy the file again from its source, or give the radar.",
        )
    wrong: list[str] = []
    told = [_chip(chip, f"mmWaveDevices[{n}]", wrong) for n, chip in enumerate(chips)]
    if wrong:
        more = f" and {len(wrong) - 8} more" if len(wrong) > 8 else ""
        raise RecordingError(
            file,
            got=f"with {', '.join(wrong[:8])}{more}",
            need="with the numbers that mmWave Studio writes, as decimals or as 0x.., for one"
            " frame of transmitters that take turns",
            fix="Record it so, or give the radar; other settings are not read yet.",
        )
    first = told[0]
    profile, masks = _one_profile(file, told)
    with values_from(file):
        sent = TiFrame(
            chirp=_ramp(profile, real=first.codes["b2AdcOutFmt"] == 0),
            interval_s=(profile["idleTimeConst_usec"] + profile["rampEndTime_usec"]) / 1e6,
            masks=masks,
            n_loops=int(first.frame["numLoops"]),
            n_frames=int(first.frame["numFrames"]),
            period_s=first.period_ms / 1e3,
            rx_mask=_joined([int(chip.codes["rxChannelEn"]) for chip in told], _RX),
        )
        return ti_settings(
            sent,
            iq="qi" if first.codes["iqSwapSel"] else "iq",
            interleaved=not first.codes["chInterleave"],
            bits=BITS[int(first.codes["b2AdcBits"])],
            named=named if len(told) == 1 else "cascade",
            device=device,
        )


@value
class _Chip:
    """What one chip was told, by the keys of the file."""

    codes: Numbers
    profiles: Sequence[Numbers]
    chirps: Sequence[Numbers]
    frame: Numbers

    @property
    def loop(self) -> range:
        """Chirps of a loop."""
        first = int(self.frame["chirpStartIdx"])
        if "numOfChirps" in self.frame:
            return range(first, first + int(self.frame["numOfChirps"]))
        return range(first, int(self.frame["chirpEndIdx"]) + 1)

    @property
    def period_ms(self) -> float:
        """From frame to frame: a frame has one sub-frame."""
        in_sub_frames = "subFramePeriodicity_msec" in self.frame
        return self.frame["subFramePeriodicity_msec" if in_sub_frames else "framePeriodicity_msec"]


def _chip(chip: Any, at: str, wrong: list[str]) -> _Chip:
    """Take the numbers of a chip; `wrong` takes what is wrong with them."""

    def numbers(path: str, keys: tuple[str, ...]) -> Numbers:
        return _numbers(_inside(chip, path), f"{at}.{path}", keys, wrong)

    def each(path: str, keys: tuple[str, ...]) -> list[Numbers]:
        parts = enumerate(_listed(chip, path))
        return [_numbers(part, f"{at}.{path}[{n}]", keys, wrong) for n, part in parts]

    radio = "rfConfig"
    codes = numbers(f"{radio}.rlChanCfg_t", _CHANNELS)
    codes |= numbers(f"{radio}.rlAdcOutCfg_t.fmt", _CODES)
    codes |= numbers("rawDataCaptureConfig.rlDevDataFmtCfg_t", _LAYOUT)
    advanced = f"{radio}.rlAdvFrameCfg_t.frameSeq"
    in_sub_frames = _inside(chip, f"{radio}.waveformType") == "advancedFrameChirp"
    in_sub_frames = in_sub_frames or _inside(chip, f"{radio}.rlFrameCfg_t") is None
    if in_sub_frames and _inside(chip, advanced) is not None:
        frame = numbers(advanced, _SEQUENCE)
        # Room for four is always there; `numOfSubFrames` says how many count.
        first = [*_listed(chip, f"{advanced}.subFrameCfg"), None][0]
        frame |= _numbers(first, f"{at}.{advanced}.subFrameCfg[0]", _SUB_FRAME, wrong)
    else:
        frame = numbers(f"{radio}.rlFrameCfg_t", _FRAME)
    if _listed(chip, f"{radio}.rlBpmChirps"):
        wrong.append(f"{at}.{radio}.rlBpmChirps (transmitters that send together)")
    for path in ("rlRfPhaseShiftCfgs", "rlDynPerChirpPhShftCfgs"):
        if any(map(_shifts, _listed(chip, f"{radio}.{path}"))):
            wrong.append(f"{at}.{radio}.{path} (phases that change from chirp to chirp)")
    return _Chip(
        codes=codes,
        profiles=each(f"{radio}.rlProfiles", _PROFILE),
        chirps=each(f"{radio}.rlChirps", _CHIRP),
        frame=frame,
    )


def _one_profile(file: Path, told: Sequence[_Chip]) -> tuple[Numbers, tuple[int, ...]]:
    """Give the profile of all chirps of the frame, and the transmitters of each."""
    first = told[0]
    profiles = {profile["profileId"]: profile for profile in first.profiles}
    loop = first.loop[:MOST_CHIRPS]
    sent = [[_sent_at(chip, index) for chip in told] for index in loop]
    chirps = [[chirp for chirp in at_once if chirp] for at_once in sent]
    used = {chirp["profileId"] for at_once in chirps for chirp in at_once[:1]}
    equal = len(used) == 1 and not any(
        chirp[key] for at_once in chirps for chirp in at_once for key in _VARIATIONS
    )
    complete = 0 <= first.loop.start < first.loop.stop <= MOST_CHIRPS
    complete = complete and all(len(made) == len(told) for made in chirps)
    if not (equal and complete and used <= profiles.keys()):
        raise RecordingError(
            file,
            got=f"with a frame of chirps {first.loop.start} to {first.loop.stop - 1} that differ"
            " or are not set",
            need="with a frame of equal chirps, of any transmitters in turn",
            fix="Record with one kind of chirp; others are not read yet.",
        )
    masks = tuple(_joined([int(chirp["txEnable"]) for chirp in made], _TX) for made in chirps)
    return profiles[used.pop()], masks


def _sent_at(chip: _Chip, index: int) -> Numbers | None:
    """Give the chirp of an index, of several the last."""
    fits = [one for one in chip.chirps if one["chirpStartIdx"] <= index <= one["chirpEndIdx"]]
    return fits[-1] if fits else None


def _joined(masks: Sequence[int], width: int) -> int:
    """One mask of the antennas of all chips; a chip alone may have any number of them."""
    if len(masks) > 1 and any(mask >> width for mask in masks):
        return 0  # of no antenna that is there; what takes the mask says so
    return sum(mask << n * width for n, mask in enumerate(masks))


def _ramp(profile: Numbers, *, real: bool) -> Chirp:
    return Chirp(
        start_frequency_hz=profile["startFreqConst_GHz"] * 1e9,
        slope_hz_per_s=profile["freqSlopeConst_MHz_usec"] * 1e12,
        adc_start_s=profile["adcStartTimeConst_usec"] / 1e6,
        ramp_duration_s=profile["rampEndTime_usec"] / 1e6,
        sample_rate_hz=profile["digOutSampleRate"] * 1e3,
        n_samples=int(profile["numAdcSamples"]),
        sampling="real" if real else "complex",
    )


def _inside(thing: Any, path: str) -> Any:
    """What lies at a path of keys; None where there is nothing."""
    for key in path.split("."):
        thing = thing.get(key) if isinstance(thing, dict) else None
    return thing


def _listed(thing: Any, path: str) -> list[Any]:
    """Parts of the list at a path; each may be wrapped in an object of one key, its kind."""
    parts = _inside(thing, path)
    return [
        next(iter(part.values())) if isinstance(part, dict) and len(part) == 1 else part
        for part in (parts if isinstance(parts, list) else [])
    ]


def _numbers(thing: Any, at: str, keys: Sequence[str], wrong: list[str]) -> Numbers:
    if not isinstance(thing, dict):
        wrong.append(f"{at} missing")
        return dict.fromkeys(keys, 0)
    found = {key: _number(thing.get(key), whole=not key.endswith(_FRACTIONS)) for key in keys}
    for key, read in found.items():
        if key not in thing:
            wrong.append(f"{at}.{key} missing")
        elif read is None or read not in _READ.get(key, (read,)):
            wrong.append(f"{at}.{key} = {shown(thing[key])}")
    return {key: read or 0 for key, read in found.items()}


def _number(thing: Any, *, whole: bool) -> float | None:
    if isinstance(thing, str) and len(thing) <= 40 and thing.isascii():
        try:
            thing = int(thing, 16) if thing.lower().startswith("0x") else float(thing)
        except ValueError:
            return None
    # No number of these files is larger; the comparison also leaves out NaN.
    right = number(thing) and abs(thing) <= 1e9 and not (whole and thing % 1)
    return float(thing) if right else None


def _shifts(part: Any) -> bool:
    """Whether a setting of phases changes any."""
    phases = part.items() if isinstance(part, dict) else ()
    return any("PhaseShift" in key and _number(one, whole=False) != 0 for key, one in phases)
