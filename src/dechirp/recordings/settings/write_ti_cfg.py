"""Writer of the commands for TI's out-of-the-box demo (`.cfg`).

Commands and their arguments: TI mmWave SDK User Guide 1.2, section on the configuration file, and
files that TI's visualizer wrote for SDK 2 and 3. Commands that the demo of SDK 3 requires before it
starts: `mss_main.c` of SDK 3.5, for each chip. The processing of the demo has the visualizer's
values; only the stream of raw samples over LVDS, which the visualizer switches off, is on where the
demo has one.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device as device_named
from dechirp.radar.devices.rules import USABLE_BAND
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings.ti_numbers import (
    check_equal_tdm_chirps,
    format_decimal_rounded_up,
    indices_to_bit_mask,
    match_antennas_to_device,
    round_to_chip_steps,
)

_BOARD_SUFFIXES = {"xwr6843": "_ISK"}  # of chips that are sold on several boards
_XWR1443 = "xwr1443"  # its demo ended with SDK 2, and has no sub-frames
_SDKS = {_XWR1443: (1, 2, 3), "xwr1642": (2, 3), "xwr1843": (3,), "xwr6843": (3,)}
_GAINS = {"xwr6843": 158}  # 30 dB and a code of the RF gain, as in TI's files
_LOW_POWER = ("xwr1642",)  # ADC in low-power mode, as in TI's files
_BPM = ("xwr1642", "xwr6843")  # demos that require bpmCfg
_THRESHOLD_DB = 15


@check_argument_types
def format_ti_cfg(
    radar: Radar,
    *,
    device: Device | str,
    n_frames: int = 0,
    sdk: int = 3,
    iq: Iq | None = None,
) -> str:
    """Return the text of the file that configures a TI device as a radar.

    Times, rates and periods are rounded to the steps of the chip. Start frequency and slope, whose
    steps are not decimal, are written exactly: the chip rounds them down. Transmitters send in the
    radar's order; the demo's own angles are right only if a raised transmitter is last.

    Parameters
    ----------
    radar : Radar
        The radar. Its array selects the antennas of the device.
    device : Device or str
        The board: xwr1443, xwr1642, xwr1843 or xwr6843, in any spelling.
    n_frames : int
        Frames to send; 0 means until stopped.
    sdk : {3, 2, 1}
        SDK of the demo: 3, or 2 for an xwr1642. The demo of the xwr1443 ended with SDK 2 and has
        accepted the same commands since 1.2, which are also written for 3.
    iq : {"iq", "qi"}, optional
        Order of I and Q in a capture that the file describes; without it, the order that the demo
        processes.

    Raises
    ------
    InvalidSetting
        If the device has no such demo, its antennas differ from the array's, or the demo has no
        command for a setting.
    DechirpError
        With every rule of the device that the rounded radar breaks.
    """
    board = device_named(device) if isinstance(device, str) else device
    check_integer("n_frames", n_frames, at_least=0, at_most=65_535)
    _check_demo_exists(board, sdk)
    tx, rx = match_antennas_to_device(radar.array, board)
    _check_expressible_as_commands(radar.frame)
    rounded = replace(radar, frame=round_to_chip_steps(radar.frame))
    broken_rules = [rule for rule in board.find_broken_rules(rounded) if rule.level == "error"]
    if broken_rules:
        raise DechirpError(
            *(
                Mistake(
                    setting=rule.setting, value=rule.value, expected=rule.expected, fix=rule.fix
                )
                for rule in broken_rules
            )
        )
    is_xwr1443 = board.kind() == _XWR1443
    index = "" if is_xwr1443 else "-1 "
    is_sdk3 = sdk == 3 and not is_xwr1443
    # Q comes first, except in the demo of SDK 2 on a DSP. The xWR1443 alternates receivers.
    is_q_first = is_sdk3 or is_xwr1443 if iq is None else iq == "qi"
    layout = f"0 {int(is_q_first)} {int(not is_xwr1443)} 1"
    lines = [
        f"% Created for SDK ver:{'03' if is_sdk3 else '02'}",
        f"% Platform:xWR{board.kind()[3:5]}xx{_BOARD_SUFFIXES.get(board.kind(), '')}",
        "sensorStop",
        "flushCfg",
        "dfeDataOutputMode 1",
        f"channelCfg {indices_to_bit_mask(rx)} {indices_to_bit_mask(tx)} 0",
        "adcCfg 2 1",
        f"adcbufCfg {index}{layout}",
        *_profile_chirp_frame_commands(
            rounded.frame, tx, n_frames, gain=_GAINS.get(board.kind(), 30)
        ),
        f"lowPower 0 {int(board.kind() in _LOW_POWER)}",
        *(
            _sdk3_processing_commands(rounded, board)
            if is_sdk3
            else _sdk2_processing_commands(rounded, board, index)
        ),
        "sensorStart",
    ]
    return "\n".join(lines) + "\n"


def _check_demo_exists(board: Device, sdk: int) -> None:
    """Raise `InvalidSetting` unless the board has a demo of this SDK."""
    sdks = _SDKS.get(board.kind())
    if sdks is None:
        raise InvalidSetting(
            "device",
            value=board.kind(),
            expected=f"one of {', '.join(_SDKS)}, whose demo accepts these commands",
            fix="use the tool of the vendor",
        )
    if sdk not in sdks:
        raise InvalidSetting(
            "sdk",
            value=sdk,
            expected=f"{' or '.join(map(str, sdks))}, for {board.kind()}",
            fix="give the SDK of the demo on the board",
        )


def _check_expressible_as_commands(frame: Frame) -> None:
    """Raise `InvalidSetting` for settings that the commands cannot express."""
    check_equal_tdm_chirps(frame)
    if frame.chirp.sampling != "complex":
        raise InvalidSetting(
            "Chirp.sampling",
            value=frame.chirp.sampling,
            expected="complex, as the demo requires",
            fix="use complex samples, at half the rate for the same range",
        )
    if frame.period_s is None:
        raise InvalidSetting(
            "Frame.period_s",
            value="missing",
            expected="a period: the chip starts frames by its clock, with pauses between them",
            fix=f"give one above {frame.duration_s * 1e3:.6g} ms",
        )


def _profile_chirp_frame_commands(
    frame: Frame, tx: Sequence[int], n_frames: int, gain: int
) -> list[str]:
    """Return the commands of profile, chirps and frame."""
    chirp = frame.chirp
    idle_s = frame.single_interval_s - chirp.ramp_duration_s
    numbers = (
        "0",
        format_decimal_rounded_up(chirp.start_frequency_hz / 1e9, 9),
        *(
            format_decimal_rounded_up(time_s * 1e6, 2)
            for time_s in (idle_s, chirp.adc_start_s, chirp.ramp_duration_s)
        ),
        "0 0",
        format_decimal_rounded_up(chirp.slope_hz_per_s / 1e12, 4),
        "1",
        str(chirp.n_samples),
        format_decimal_rounded_up(chirp.sample_rate_hz / 1e3, 0),
        f"0 0 {gain}",
    )
    tx_masks = [1 << tx[index] for index in frame.tdm_order or ()]
    period_ms = format_decimal_rounded_up((frame.period_s or frame.duration_s) * 1e3, 6)
    return [
        f"profileCfg {' '.join(numbers)}",
        *(f"chirpCfg {n} {n} 0 0 0 0 0 {mask}" for n, mask in enumerate(tx_masks)),
        f"frameCfg 0 {len(tx_masks) - 1} {frame.n_chirps} {n_frames} {period_ms} 1 0",
    ]


def _sdk3_processing_commands(radar: Radar, board: Device) -> list[str]:
    """Return the processing commands of the demo of SDK 3."""
    frame, chirp = radar.frame, radar.frame.chirp
    velocity = f"{frame.max_velocity_m_per_s:.2f}"
    return [
        "guiMonitor -1 1 1 0 0 0 1",
        f"cfarCfg -1 0 2 8 4 3 0 {_THRESHOLD_DB} 1",
        f"cfarCfg -1 1 0 4 2 3 1 {_THRESHOLD_DB} 1",
        "multiObjBeamForming -1 1 0.5",
        "clutterRemoval -1 0",
        "calibDcRangeSig -1 0 -5 8 256",
        "extendedMaxVelocity -1 0",
        *(["bpmCfg -1 0 0 1"] if board.kind() in _BPM else []),
        "lvdsStreamCfg -1 0 1 0",
        *_neutral_correction_commands(board),
        *_disabled_monitor_commands(chirp),
        "aoaFovCfg -1 -90 90 -90 90",
        f"cfarFovCfg -1 0 0 {USABLE_BAND * chirp.max_range_m:.2f}",
        f"cfarFovCfg -1 1 -{velocity} {velocity}",
        "calibData 0 0 0",
    ]


def _sdk2_processing_commands(radar: Radar, board: Device, subframe_index: str) -> list[str]:
    """Return the processing commands of the demos of SDK 1 and 2, with logarithmic thresholds."""
    # Bins of the next power of two; for the xWR1443 the visualizer omits the last tenth.
    n_bins = 1 << (radar.frame.chirp.n_samples - 1).bit_length()
    last_bin = (n_bins * 9 // 10 if board.kind() == _XWR1443 else n_bins) - 1
    lines = [f"guiMonitor {subframe_index}1 1 0 0 0 1"]
    if board.kind() == _XWR1443:
        lines += [f"cfarCfg 0 2 8 4 3 0 {512 * _THRESHOLD_DB // 6}"]
    else:
        threshold = 256 * radar.n_channels * _THRESHOLD_DB // 6
        lines += [
            f"cfarCfg {subframe_index}0 0 8 4 4 0 {threshold}",
            f"cfarCfg {subframe_index}1 0 4 2 3 0 {threshold}",
        ]
    lines += [
        f"peakGrouping {subframe_index}1 1 1 1 {last_bin}",
        f"multiObjBeamForming {subframe_index}1 0.5",
        f"clutterRemoval {subframe_index}0",
        f"calibDcRangeSig {subframe_index}0 -5 8 256",
        *_neutral_correction_commands(board),
        *_disabled_monitor_commands(radar.frame.chirp),
    ]
    if board.kind() != _XWR1443:
        lines += [
            f"extendedMaxVelocity {subframe_index}0",
            f"bpmCfg {subframe_index}0 0 1",
            f"nearFieldCfg {subframe_index}0 0 0",
            f"lvdsStreamCfg {subframe_index}0 1 0",
        ]
    return lines


def _neutral_correction_commands(board: Device) -> list[str]:
    """Return the commands without range bias and channel corrections."""
    pairs = " 1 0" * (len(board.tx_m) * len(board.rx_m))
    return [
        f"compRangeBiasAndRxChanPhase 0.0{pairs}",
        "measureRangeBiasAndRxChanPhase 0 1.5 0.2",
    ]


def _disabled_monitor_commands(chirp: Chirp) -> list[str]:
    """Return the commands of disabled monitors, with slices that fit into a chirp: at most 64.

    A saturation slice lasts a multiple of 0.16 us, at least four; one of the image band has an even
    number of samples, at least four. Between two whole slices lies a shifted one.
    """
    ticks = max(4, math.ceil(chirp.sampled_duration_s / 0.16e-6 / 65 + 1e-9))
    n_long = min(64, max(1, math.floor(chirp.sampled_duration_s / (ticks * 0.16e-6))))
    samples = max(4, 2 * math.ceil((chirp.n_samples + 1) / 65 / 2))
    n_even = min(64, max(1, chirp.n_samples // samples))
    return [
        f"CQRxSatMonitor 0 3 {ticks} {2 * n_long - 1} 0",
        f"CQSigImgMonitor 0 {2 * n_even - 1} {samples}",
        "analogMonitor 0 0",
    ]
