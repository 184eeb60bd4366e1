"""Writer of the settings that TI's mmWave Studio stores beside a capture.

`.mmwave.json` contains the settings of the chip; `.setup.json` names the chip, that file and the
captured one. Keys and their order follow files of mmWave Studio 2.1. Values about monitoring,
calibration and the recorder are those of a capture, not of a test plan.
"""

import json
from pathlib import PurePath
from typing import Any

from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings.ti_frame import BITS
from dechirp.recordings.settings.ti_numbers import (
    check_equal_tdm_chirps,
    format_decimal_rounded_up,
    indices_to_bit_mask,
    round_to_chip_steps,
)

_FEW_LANES = 2  # of chips that write one receiver after the other


def format_mmwave_json(
    radar: Radar,
    *,
    tx: tuple[int, ...],
    rx: tuple[int, ...],
    lanes: int,
    n_frames: int = 0,
    iq: Iq = "iq",
    bits: int = 16,
) -> str:
    """Return the text of a `.mmwave.json` that describes a capture of one chip.

    Times, rates and periods are rounded to the steps of the chip; frames without a period follow
    each other without pause. The limits of the chip are not checked.

    Parameters
    ----------
    radar : Radar
        The radar: equal chirps, of transmitters that take turns.
    tx, rx : tuple of int
        Index on the chip, from 0, of each antenna of the array.
    lanes : {2, 4}
        LVDS lanes; with 2 the receivers come one after the other.
    n_frames : int
        Number of frames; 0 means until stopped.
    iq : {"iq", "qi"}
        Order of I and Q of a sample.
    bits : {16, 14, 12}
        ADC bits.

    Raises
    ------
    InvalidSetting
        If chirps differ, or several transmitters send in one.
    """
    check_equal_tdm_chirps(radar.frame)
    frame = round_to_chip_steps(radar.frame)
    device = {
        "mmWaveDeviceId": 0,
        "rfConfig": {
            "waveformType": "legacyFrameChirp",
            "MIMOScheme": "TDM",
            "rlChanCfg_t": {
                "rxChannelEn": hex(indices_to_bit_mask(rx)),
                "txChannelEn": hex(indices_to_bit_mask(tx)),
                "cascading": 0,
                "cascadingPinoutCfg": "0x0",
            },
            "rlAdcOutCfg_t": {
                "fmt": {
                    "b2AdcBits": {adc_bits: code for code, adc_bits in BITS.items()}[bits],
                    "b8FullScaleReducFctr": 0,
                    "b2AdcOutFmt": int(frame.chirp.sampling == "complex"),
                }
            },
            "rlLowPowerModeCfg_t": {"lpAdcMode": 0},
            "rlProfiles": [{"rlProfileCfg_t": _profile_json_fields(frame)}],
            "rlChirps": [
                {"rlChirpCfg_t": _chirp_json_fields(number, 1 << tx[turn])}
                for number, turn in enumerate(frame.tdm_order or ())
            ],
            "rlFrameCfg_t": {
                "chirpStartIdx": 0,
                "chirpEndIdx": frame.n_slots - 1,
                "numLoops": frame.n_chirps,
                "numFrames": n_frames,
                "framePeriodicity_msec": _round_to_twelve_digits(
                    (frame.period_s or frame.duration_s) * 1e3
                ),
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
    return _dump_json(
        {
            "configGenerator": {"createdBy": "dechirp", "isConfigIntermediate": 1},
            "currentVersion": {"jsonCfgVersion": {"major": 0, "minor": 4, "patch": 0}},
            "mmWaveDevices": [device],
        }
    )


def format_mmwave_setup(device: Device, *, settings_file: PurePath, capture_file: PurePath) -> str:
    """Return the text of the `.setup.json` that belongs to a `.mmwave.json`.

    Parameters
    ----------
    device : Device
        The chip, on its board.
    settings_file, capture_file : path
        The `.mmwave.json` and the `.bin`, in the same folder.
    """
    digits = device.kind()[3:]
    at_60_ghz = digits.startswith("6")
    return _dump_json(
        {
            "configUsed": settings_file.name,
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
                        "rawFileName": capture_file.name,
                        "processedFileName": capture_file.name,
                        "processedFileSummary": {"numZeroFillBytes": 0},
                    }
                ],
            },
        }
    )


def _profile_json_fields(frame: Frame) -> dict[str, Any]:
    """Return the fields of a profile."""
    chirp = frame.chirp
    return {
        "profileId": 0,
        "pfVcoSelect": "0x0",
        "pfCalLutUpdate": "0x0",
        # As many digits as in a .cfg, so that both files agree.
        "startFreqConst_GHz": float(format_decimal_rounded_up(chirp.start_frequency_hz / 1e9, 9)),
        "idleTimeConst_usec": _round_to_twelve_digits(
            (frame.single_interval_s - chirp.ramp_duration_s) * 1e6
        ),
        "adcStartTimeConst_usec": _round_to_twelve_digits(chirp.adc_start_s * 1e6),
        "rampEndTime_usec": _round_to_twelve_digits(chirp.ramp_duration_s * 1e6),
        "txOutPowerBackoffCode": "0x0",
        "txPhaseShifter": "0x0",
        "freqSlopeConst_MHz_usec": float(format_decimal_rounded_up(chirp.slope_hz_per_s / 1e12, 4)),
        "txStartTime_usec": 0.0,
        "numAdcSamples": chirp.n_samples,
        "digOutSampleRate": round(chirp.sample_rate_hz / 1e3),
        "hpfCornerFreq1": 0,
        "hpfCornerFreq2": 0,
        "rxGain_dB": "0x1E",
    }


def _chirp_json_fields(chirp_index: int, tx_mask: int) -> dict[str, Any]:
    """Return the fields of a chirp."""
    return {
        "chirpStartIdx": chirp_index,
        "chirpEndIdx": chirp_index,
        "profileId": 0,
        "startFreqVar_MHz": 0.0,
        "freqSlopeVar_KHz_usec": 0.0,
        "idleTimeVar_usec": 0.0,
        "adcStartTimeVar_usec": 0.0,
        "txEnable": hex(tx_mask),
    }


def _round_to_twelve_digits(number: float) -> float:
    """Round to twelve digits, so that 60 us are 60 in spite of a division."""
    return float(f"{number:.12g}")


def _dump_json(document: dict[str, Any]) -> str:
    """Return a document as indented JSON."""
    return json.dumps(document, indent=2) + "\n"
