"""A radar as the settings that TI's mmWave Studio keeps beside a capture.

`.mmwave.json` says what the chip was told, `.setup.json` names the chip, that file and the
captured one. Keys and their order: files that mmWave Studio 2.1 wrote. What is said of
monitoring, of calibration and of the recorder is what describes a capture, not a test plan.
"""

import json
from pathlib import PurePath
from typing import Any

from dechirp.formats.settings.base import Iq
from dechirp.formats.settings.ti_frame import BITS
from dechirp.formats.settings.ti_numbers import decimal, in_steps, mask, must_be_one_profile
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_FEW_LANES = 2  # of chips that write one receiver after the other


def mmwave_json_text(
    radar: Radar,
    *,
    tx: tuple[int, ...],
    rx: tuple[int, ...],
    lanes: int,
    n_frames: int = 0,
    iq: Iq = "iq",
    bits: int = 16,
) -> str:
    """Text of a `.mmwave.json` that describes a capture of one chip.

    Times, rates and periods are rounded to the chip's steps; frames without a period follow
    each other at once. The chip's limits are not asked: a radar that no chip can be is described
    as well.

    Parameters
    ----------
    radar : Radar
        What was sent: equal chirps, of transmitters that take turns.
    tx, rx : tuple of int
        Place on the chip, from 0, of each antenna of the array.
    lanes : {2, 4}
        Over which the samples left: with 2 the receivers come one after the other.
    n_frames : int
        Frames that were sent; 0: until stopped.
    iq : {"iq", "qi"}
        Which part of a complex sample comes first.
    bits : {16, 14, 12}
        Of the converter.

    Raises
    ------
    InvalidSetting
        If chirps differ, or several transmitters send in one.
    """
    must_be_one_profile(radar.frame)
    frame = in_steps(radar.frame)
    device = {
        "mmWaveDeviceId": 0,
        "rfConfig": {
            "waveformType": "legacyFrameChirp",
            "MIMOScheme": "TDM",
            "rlChanCfg_t": {
                "rxChannelEn": hex(mask(rx)),
                "txChannelEn": hex(mask(tx)),
                "cascading": 0,
                "cascadingPinoutCfg": "0x0",
            },
            "rlAdcOutCfg_t": {
                "fmt": {
                    "b2AdcBits": {known: code for code, known in BITS.items()}[bits],
                    "b8FullScaleReducFctr": 0,
                    "b2AdcOutFmt": int(frame.chirp.sampling == "complex"),
                }
            },
            "rlLowPowerModeCfg_t": {"lpAdcMode": 0},
            "rlProfiles": [{"rlProfileCfg_t": _profile(frame)}],
            "rlChirps": [
                {"rlChirpCfg_t": _chirp(number, 1 << tx[turn])}
                for number, turn in enumerate(frame.turns or ())
            ],
            "rlFrameCfg_t": {
                "chirpStartIdx": 0,
                "chirpEndIdx": frame.n_slots - 1,
                "numLoops": frame.n_chirps,
                "numFrames": n_frames,
                "framePeriodicity_msec": _digits((frame.period_s or frame.duration_s) * 1e3),
                "triggerSelect": 1,
                "numDummyChirpsAtEnd": 0,
                "frameTriggerDelay": 0.0,
            },
            "rlBpmChirps": [],
            "rlRfPhaseShiftCfgs": [],
            "rlDynPerChirpPhShftCfgs": [],
        },
        "rawDataCaptureConfig": {
            "rlDevDataFmtCfg_t": {
                "iqSwapSel": int(iq == "qi"),
                "chInterleave": int(lanes == _FEW_LANES),
            },
            "rlDevDataPathCfg_t": {
                "intfSel": 1,
                "transferFmtPkt0": "0x1",
                "transferFmtPkt1": "0x0",
                "cqConfig": 2,
                "cq0TransSize": 0,
                "cq1TransSize": 0,
                "cq2TransSize": 0,
            },
            "rlDevLaneEnable_t": {"laneEn": hex(2**lanes - 1)},
            "rlDevDataPathClkCfg_t": {"laneClkCfg": 1, "dataRate_Mbps": 600},
            "rlDevLvdsLaneCfg_t": {"laneFmtMap": 0, "laneParamCfg": "0x1"},
        },
        "monitoringConfig": {},
    }
    return _text(
        {
            "configGenerator": {"createdBy": "dechirp", "isConfigIntermediate": 1},
            "currentVersion": {"jsonCfgVersion": {"major": 0, "minor": 4, "patch": 0}},
            "mmWaveDevices": [device],
        }
    )


def mmwave_setup_text(of: Device, *, used: PurePath, captured: PurePath) -> str:
    """Text of the `.setup.json` that belongs to a `.mmwave.json`.

    Parameters
    ----------
    of : Device
        The chip, on its board.
    used, captured : path
        The `.mmwave.json` and the `.bin`, which lie in the same folder.
    """
    digits = of.kind()[3:]
    at_60_ghz = digits.startswith("6")
    return _text(
        {
            "configUsed": used.name,
            "captureHardware": "DCA1000",
            "DCA1000Config": {
                "dataLoggingMode": "raw",
                "dataTransferMode": "LVDSCapture",
                "dataCaptureMode": "ethernetStream",
                "packetSequenceEnable": 1,
                "packetDelay_us": 25,
            },
            "mmWaveDevice": f"{'iwr' if at_60_ghz else 'awr'}{digits}",
            "operatingFreq": 60 if at_60_ghz else 77,
            "capturedFiles": {
                "numFilesCollected": 1,
                "fileBasePath": ".",
                "files": [
                    {
                        "rawFileName": captured.name,
                        "processedFileName": captured.name,
                        "processedFileSummary": {"numZeroFillBytes": 0},
                    }
                ],
            },
        }
    )


def _profile(frame: Frame) -> dict[str, Any]:
    chirp = frame.chirp
    return {
        "profileId": 0,
        "pfVcoSelect": "0x0",
        "pfCalLutUpdate": "0x0",
        # As many digits as a .cfg has, which is to say the same.
        "startFreqConst_GHz": float(decimal(chirp.start_frequency_hz / 1e9, 9)),
        "idleTimeConst_usec": _digits((frame.only_interval_s - chirp.ramp_duration_s) * 1e6),
        "adcStartTimeConst_usec": _digits(chirp.adc_start_s * 1e6),
        "rampEndTime_usec": _digits(chirp.ramp_duration_s * 1e6),
        "txOutPowerBackoffCode": "0x0",
        "txPhaseShifter": "0x0",
        "freqSlopeConst_MHz_usec": float(decimal(chirp.slope_hz_per_s / 1e12, 4)),
        "txStartTime_usec": 0.0,
        "numAdcSamples": chirp.n_samples,
        "digOutSampleRate": round(chirp.sample_rate_hz / 1e3),
        "hpfCornerFreq1": 0,
        "hpfCornerFreq2": 0,
        "rxGain_dB": "0x1E",
    }


def _chirp(number: int, tx_mask: int) -> dict[str, Any]:
    return {
        "chirpStartIdx": number,
        "chirpEndIdx": number,
        "profileId": 0,
        "startFreqVar_MHz": 0.0,
        "freqSlopeVar_KHz_usec": 0.0,
        "idleTimeVar_usec": 0.0,
        "adcStartTimeVar_usec": 0.0,
        "txEnable": hex(tx_mask),
    }


def _digits(number: float) -> float:
    """Twelve digits: 60 us are 60, and not what is left of a division."""
    return float(f"{number:.12g}")


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=2) + "\n"
