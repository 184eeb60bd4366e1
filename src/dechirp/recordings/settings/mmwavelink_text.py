"""TI mmWaveLink example: `mmwaveconfig.txt`, a line `key=value;` for each field of its structures.

The example sets up AWR1243 and AWR2243 over SPI. Fields are named and ordered as in `rl_sensor.h`;
their numbers count steps of the chip: 53.644 Hz, 48.279 kHz/us, 10 ns, and 5 ns for the period.
"""

import json
import re
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import FREQUENCY_STEP_77_HZ, SLOPE_STEP_77_HZ_PER_S
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings.mmwave_json import read_mmwave_json

_FIELD = re.compile(
    r"^[ \t]*([A-Za-z]\w*)[ \t]*=[ \t]*(-?(?:0x[0-9a-fA-F]+|\d+\.?\d*))", re.MULTILINE
)
_ADVANCED_TESTS = ("LinkAdvanceFrameTest", "LinkContModeTest", "LinkAdvChirpTest")
_TIMES_PER_US, _PERIODS_PER_MS = 100, 200_000

Fields = list[tuple[str, float]]


def is_mmwavelink_text(text: str) -> bool:
    """Return whether a text is such a file."""
    return re.search(r"^[ \t]*startFreqConst[ \t]*=", text, re.MULTILINE) is not None


def read_mmwavelink_text(file: Path, text: str, device: Device | None = None) -> RecordingSettings:
    """Read the settings.

    Raises
    ------
    RecordingError
        If fields are missing, advanced frames or chirps are enabled, or the chirps are unsupported,
        see `read_mmwave_json`, whose names of the fields the message uses.
    """
    fields = [(key, float(int(value, 16) if "x" in value.lower() else float(value)))
              for key, value in _FIELD.findall(text)]  # fmt: skip
    enabled = [key for key, value in fields if key in _ADVANCED_TESTS and value]
    if enabled:
        raise RecordingError(
            file,
            value=f"{enabled[0]}=1",
            expected="frames of chirps as chirpStartIdx and the fields after it define them",
            fix="give the radar as a YAML file; other modes are not supported yet",
        )
    document = {"mmWaveDevices": [_chip_of_fields(fields)]}
    return read_mmwave_json(file, json.dumps(document), device)


def _chip_of_fields(fields: Fields) -> dict[str, object]:
    """Return the settings of the chip as in a `.mmwave.json` file."""
    last = dict(fields)
    first = dict(reversed(fields))  # numAdcSamples is also a field of the frame, with another unit
    profile = {
        "profileId": first.get("profileId"),
        "startFreqConst_GHz": _scaled(first, "startFreqConst", 1e9 / FREQUENCY_STEP_77_HZ),
        "idleTimeConst_usec": _scaled(first, "idleTimeConst", _TIMES_PER_US),
        "adcStartTimeConst_usec": _scaled(first, "adcStartTimeConst", _TIMES_PER_US),
        "rampEndTime_usec": _scaled(first, "rampEndTime", _TIMES_PER_US),
        "freqSlopeConst_MHz_usec": _scaled(first, "freqSlopeConst", 1e12 / SLOPE_STEP_77_HZ_PER_S),
        "numAdcSamples": first.get("numAdcSamples"),
        "digOutSampleRate": first.get("digOutSampleRate"),
    }
    groups = _groups_of_chirps(fields)
    chirps = [
        {
            "chirpStartIdx": group.get("chirpStartIdx"),
            "chirpEndIdx": group.get("chirpEndIdx"),
            "profileId": group.get("profileIdCPCFG"),
            "startFreqVar_MHz": group.get("startFreqVar"),
            "freqSlopeVar_KHz_usec": group.get("freqSlopeVar"),
            "idleTimeVar_usec": group.get("idleTimeVar"),
            "adcStartTimeVar_usec": group.get("adcStartTimeVar"),
            "txEnable": group.get("txEnable"),
        }
        for group in groups
        if "constBpmVal" not in group
    ]
    frame = {
        "chirpStartIdx": last.get("chirpStartIdxFCF"),
        "chirpEndIdx": last.get("chirpEndIdxFCF"),
        "numLoops": last.get("loopCount"),
        "numFrames": last.get("frameCount"),
        "framePeriodicity_msec": _scaled(last, "periodicity", _PERIODS_PER_MS),
    }
    return {
        "rfConfig": {
            "rlChanCfg_t": {
                "rxChannelEn": last.get("channelRx"),
                "txChannelEn": last.get("channelTx"),
            },
            "rlAdcOutCfg_t": {
                "fmt": {"b2AdcBits": last.get("adcBits"), "b2AdcOutFmt": last.get("adcFormat")}
            },
            "rlProfiles": [profile],
            "rlChirps": chirps,
            "rlBpmChirps": [group for group in groups if "constBpmVal" in group],
            "rlFrameCfg_t": frame,
        },
        "rawDataCaptureConfig": {
            "rlDevDataFmtCfg_t": {
                "iqSwapSel": last.get("iqSwapSel"),
                "chInterleave": last.get("chInterleave"),
            }
        },
    }


def _scaled(fields: dict[str, float], key: str, steps_per_unit: float) -> float | None:
    """Return a number of steps in a unit; None without the field."""
    return fields[key] / steps_per_unit if key in fields else None


def _groups_of_chirps(fields: Fields) -> list[dict[str, float]]:
    """Return the fields from each `chirpStartIdx` on, to the last field of its structure."""
    groups: list[dict[str, float]] = []
    is_open = False
    for key, value in fields:
        if key == "chirpStartIdx":
            groups.append({})
            is_open = True
        if is_open:
            groups[-1][key] = value
        is_open = is_open and key not in ("txEnable", "constBpmVal")
    return groups
