"""A radar as the commands that TI's out-of-the-box demo is sent (`.cfg`).

Commands and the order of their numbers: TI mmWave SDK User Guide 1.2, its section on the
configuration file, and files that TI's visualizer wrote for SDK 2 and 3. Which commands the
demo of SDK 3 waits for before it starts: `mss_main.c` of SDK 3.5, for each chip. How the demo
itself processes is left at what the visualizer writes; only the stream of raw samples over LVDS,
which the visualizer switches off, is on where the demo has one.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from dechirp.core.checks import whole
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.formats.settings.base import Iq
from dechirp.formats.settings.ti_numbers import (
    antennas_on,
    decimal,
    in_steps,
    mask,
    must_be_one_profile,
)
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.known import device as device_named
from dechirp.radar.devices.rules import USABLE_BAND
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_FIRST = "xwr1443"  # its demo ended with SDK 2, and knows no sub-frames
_SDKS = {_FIRST: (1, 2, 3), "xwr1642": (2, 3), "xwr1843": (3,), "xwr6843": (3,)}
_GAINS = {"xwr6843": 158}  # 30 dB, and a code for the radio's own, as TI's files have it
_LOW_POWER = ("xwr1642",)  # whose converter TI's files run in its mode of less power
_BPM = ("xwr1642", "xwr6843")  # whose demos also wait for the code of their transmitters
_THRESHOLD_DB = 15


def ti_cfg_text(
    radar: Radar,
    *,
    device: Device | str,
    n_frames: int = 0,
    sdk: int = 3,
    iq: Iq | None = None,
) -> str:
    """Text of the file with which a TI device becomes a radar.

    Times, rates and periods are rounded to the chip's steps. Start and slope, whose steps
    are no decimals, are written as they are: the chip itself rounds them down. Transmitters
    send in the radar's order; the demo's own angles are right only where a raised one is last.

    Parameters
    ----------
    radar : Radar
        What it shall send. Its array tells which of the device's antennas are switched on.
    device : Device or str
        The board: xwr1443, xwr1642, xwr1843 or xwr6843, however it is spelled.
    n_frames : int
        Frames to send; 0: until stopped.
    sdk : {3, 2, 1}
        SDK of the demo: 3, or 2 for an xwr1642. That of the xwr1443 ended with 2, and takes the
        same commands since 1.2: it gets them for 3 as well.
    iq : {"iq", "qi"}, optional
        Which part of a sample comes first in a capture that the file shall describe; without
        it as the demo processes them.

    Raises
    ------
    InvalidSetting
        If the device has no such demo, its antennas lie elsewhere than the array's, or the
        demo cannot be told a setting.
    DechirpError
        With every rule of the device that the rounded radar breaks.
    """
    of = device_named(device) if isinstance(device, str) else device
    whole("n_frames", n_frames, at_least=0, at_most=65_535)
    _demo_must_be(of, sdk)
    tx, rx = antennas_on(radar.array, of)
    _must_be_told(radar.frame)
    rounded = replace(radar, frame=in_steps(radar.frame))
    broken = [rule for rule in of.broken_rules(rounded) if rule.level == "error"]
    if broken:
        raise DechirpError(
            *(
                Mistake(setting=rule.setting, got=rule.got, need=rule.need, fix=rule.fix)
                for rule in broken
            )
        )
    first = of.kind() == _FIRST
    index = "" if first else "-1 "
    new = sdk == 3 and not first
    # Q comes first, but for the demo of SDK 2 on a DSP. The first chip alternates receivers.
    q_first = new or first if iq is None else iq == "qi"
    layout = f"0 {int(q_first)} {int(not first)} 1"
    lines = [
        f"% Created for SDK ver:{'03' if new else '02'}",
        f"% Platform:xWR{of.kind()[3:5]}xx",
        "sensorStop",
        "flushCfg",
        "dfeDataOutputMode 1",
        f"channelCfg {mask(rx)} {mask(tx)} 0",
        "adcCfg 2 1",
        f"adcbufCfg {index}{layout}",
        *_sent(rounded.frame, tx, n_frames, gain=_GAINS.get(of.kind(), 30)),
        f"lowPower 0 {int(of.kind() in _LOW_POWER)}",
        *(_processing(rounded, of) if new else _earlier_processing(rounded, of, index)),
        "sensorStart",
    ]
    return "\n".join(lines) + "\n"


def _demo_must_be(of: Device, sdk: int) -> None:
    sdks = _SDKS.get(of.kind())
    if sdks is None:
        raise InvalidSetting(
            "device",
            got=of.kind(),
            need=f"one of {', '.join(_SDKS)}, whose demo takes these commands",
            fix="Set it up with the tool of its vendor.",
        )
    if sdk not in sdks:
        raise InvalidSetting(
            "sdk",
            got=sdk,
            need=f"{' or '.join(map(str, sdks))}, for {of.kind()}",
            fix="Name the SDK whose demo runs on the board.",
        )


def _must_be_told(frame: Frame) -> None:
    """Raise `InvalidSetting` for what the commands have no numbers for."""
    must_be_one_profile(frame)
    if frame.chirp.sampling != "complex":
        raise InvalidSetting(
            "Chirp.sampling",
            got=frame.chirp.sampling,
            need="complex: the demo processes no other samples",
            fix="Take complex samples, at half the rate for the same range.",
        )
    if frame.period_s is None:
        raise InvalidSetting(
            "Frame.period_s",
            got="none",
            need="given: the chip starts frames by its clock, and rests between them",
            fix=f"Give one above {frame.duration_s * 1e3:.6g} ms.",
        )


def _sent(frame: Frame, tx: Sequence[int], n_frames: int, gain: int) -> list[str]:
    """Commands that say what is sent."""
    chirp = frame.chirp
    idle_s = frame.only_interval_s - chirp.ramp_duration_s
    numbers = (
        "0",
        decimal(chirp.start_frequency_hz / 1e9, 9),
        *(
            decimal(time_s * 1e6, 2)
            for time_s in (idle_s, chirp.adc_start_s, chirp.ramp_duration_s)
        ),
        "0 0",
        decimal(chirp.slope_hz_per_s / 1e12, 4),
        "1",
        str(chirp.n_samples),
        decimal(chirp.sample_rate_hz / 1e3, 0),
        f"0 0 {gain}",
    )
    turns = [1 << tx[index] for index in frame.turns or ()]
    period_ms = decimal((frame.period_s or frame.duration_s) * 1e3, 6)
    return [
        f"profileCfg {' '.join(numbers)}",
        *(f"chirpCfg {n} {n} 0 0 0 0 0 {mask}" for n, mask in enumerate(turns)),
        f"frameCfg 0 {len(turns) - 1} {frame.n_chirps} {n_frames} {period_ms} 1 0",
    ]


def _processing(radar: Radar, of: Device) -> list[str]:
    """What the demo of SDK 3 must be told of its own processing."""
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
        *(["bpmCfg -1 0 0 1"] if of.kind() in _BPM else []),
        "lvdsStreamCfg -1 0 1 0",
        *_no_corrections(of),
        *_monitors(chirp),
        "aoaFovCfg -1 -90 90 -90 90",
        f"cfarFovCfg -1 0 0 {USABLE_BAND * chirp.max_range_m:.2f}",
        f"cfarFovCfg -1 1 -{velocity} {velocity}",
        "calibData 0 0 0",
    ]


def _earlier_processing(radar: Radar, of: Device, index: str) -> list[str]:
    """What the demos of SDK 1 and 2 must be told, whose thresholds are logarithms."""
    # Bins of the next power of two; the visualizer leaves out the last tenth for the first chip.
    n_bins = 1 << (radar.frame.chirp.n_samples - 1).bit_length()
    last_bin = (n_bins * 9 // 10 if of.kind() == _FIRST else n_bins) - 1
    lines = [f"guiMonitor {index}1 1 0 0 0 1"]
    if of.kind() == _FIRST:
        lines += [f"cfarCfg 0 2 8 4 3 0 {512 * _THRESHOLD_DB // 6}"]
    else:
        threshold = 256 * radar.n_channels * _THRESHOLD_DB // 6
        lines += [
            f"cfarCfg {index}0 0 8 4 4 0 {threshold}",
            f"cfarCfg {index}1 0 4 2 3 0 {threshold}",
        ]
    lines += [
        f"peakGrouping {index}1 1 1 1 {last_bin}",
        f"multiObjBeamForming {index}1 0.5",
        f"clutterRemoval {index}0",
        f"calibDcRangeSig {index}0 -5 8 256",
        *_no_corrections(of),
        *_monitors(radar.frame.chirp),
    ]
    if of.kind() != _FIRST:
        lines += [
            f"extendedMaxVelocity {index}0",
            f"bpmCfg {index}0 0 1",
            f"nearFieldCfg {index}0 0 0",
            f"lvdsStreamCfg {index}0 1 0",
        ]
    return lines


def _no_corrections(of: Device) -> list[str]:
    pairs = " 1 0" * (len(of.tx_m) * len(of.rx_m))
    return [
        f"compRangeBiasAndRxChanPhase 0.0{pairs}",
        "measureRangeBiasAndRxChanPhase 0 1.5 0.2",
    ]


def _monitors(chirp: Chirp) -> list[str]:
    """Monitors, switched off, of slices that fit into a chirp: at most 64 of them.

    A saturation slice lasts so many 0.16 us, four at least; one of the image band takes an
    even number of samples, four at least. Between two whole slices lies a shifted one.
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
