"""Choice of the TI chip in whose format a recording is written: antennas, lanes, word order."""

from dataclasses import replace

import numpy as np

from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device as device_named
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import Recording
from dechirp.recordings.samples.layouts import N_LANES, FourLanes, SampleCode, TwoLanes
from dechirp.recordings.settings.antenna_positions import find_device_or_none
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings.ti_frame import BITS
from dechirp.recordings.settings.ti_numbers import (
    check_equal_tdm_chirps,
    match_antennas_to_device,
    round_to_chip_steps,
)
from dechirp.recordings.settings.write_ti_cfg import format_ti_cfg

CFG_BITS = BITS[2]
"""ADC bits of the demo."""
_BOARDS = ("xwr1843", "xwr6843", "xwr1642", "xwr1443")  # in order of preference
_MAX_TX = 3
_MAX_FRAMES = 65_535  # that the chip can count
_MAX_RANGE_ERROR = 1e-3  # relative range error by rounding to the steps of a chip
_PAUSE_S = 1e-3  # pause after a frame; the chips need 300 us


@frozen_dataclass
class TiChip:
    """The chip in whose format a recording is written."""

    device: Device
    lanes: int
    tx: tuple[int, ...]
    """Index on the chip of each antenna of the array."""
    rx: tuple[int, ...]
    is_board: bool
    """Whether the antennas lie as on its board."""
    iq: Iq

    def codes_to_bytes(self, codes: np.ndarray) -> bytes:
        """Return the words of a frame, from codes (chirp, rx, sample) or (chirp, rx, sample, 2)."""
        layout = TwoLanes() if self.lanes != N_LANES else FourLanes(receivers=self.rx)
        return layout.encode(codes, SampleCode(iq=self.iq)).astype("<i2", copy=False).tobytes()


def check_fits_single_chip(radar: Radar) -> None:
    """Raise `DechirpError` unless a single TI chip can have such chirps and antennas."""
    for name, positions, max_count in (
        ("rx", radar.array.rx_m, N_LANES),
        ("tx", radar.array.tx_m, _MAX_TX),
    ):
        if len(positions) > max_count:
            raise InvalidSetting(
                f"Radar.array.{name}_m",
                value=f"{len(positions)} antennas",
                expected=f"at most {max_count}: a DCA1000 captures one chip, with"
                f" {N_LANES} receivers on {N_LANES} lanes and {_MAX_TX} transmitters",
                fix="write another format, such as .h5, or fewer antennas",
            )
    check_equal_tdm_chirps(radar.frame)
    chirp = radar.frame.chirp
    rate_hz, slope = round(chirp.sample_rate_hz, -3), round(chirp.slope_hz_per_s, -8)
    relative_error = max(
        abs(rate_hz / chirp.sample_rate_hz - 1), abs(slope / chirp.slope_hz_per_s - 1)
    )
    if relative_error > _MAX_RANGE_ERROR:
        raise InvalidSetting(
            "Radar.frame.chirp",
            value=f"{format_si(chirp.sample_rate_hz, 'hz')} and"
            f" {format_si(chirp.slope_hz_per_s, 'hz_per_s')}",
            expected="a rate in steps of 1 kS/s and a slope in steps of 0.1 kHz/us, to 0.1 %",
            fix="write another format, such as .h5",
        )
    round_to_chip_steps(radar.frame)


def choose_chip(recording: Recording) -> TiChip:
    """Return the chip of the recording, else a suitable one, preferably one with a `.cfg`."""
    radar = recording.radar
    chip_device = find_device_or_none(recording.contents.device or "")
    if chip_device is not None and chip_device.lvds_lanes is not None:
        chips = [_assign_antennas_to_chip(chip_device, recording)]
    else:
        chips = [_assign_antennas_to_chip(device_named(kind), recording) for kind in _BOARDS]
    possible_chips = [
        chip for chip in chips if _can_fill_word_groups(chip, radar, recording.n_frames)
    ]
    if not possible_chips:
        chirp = radar.frame.chirp
        raise InvalidSetting(
            "Radar.frame.chirp.n_samples",
            value=f"{chirp.n_samples} {chirp.sampling} samples of {radar.array.n_rx} receivers",
            expected="complete groups of two complex samples and of 8 bytes, as written by"
            f" {' or '.join(chip.device.kind() for chip in chips)}",
            fix="leave the last sample out, or write another format, such as .h5",
        )
    describable_chips = [
        chip
        for chip in possible_chips
        if format_cfg_or_reason(recording, chip, CFG_BITS)[0] is not None
    ]
    board_chips = [chip for chip in possible_chips if chip.is_board]
    return [*describable_chips, *board_chips, *possible_chips][0]


def _assign_antennas_to_chip(device: Device, recording: Recording) -> TiChip:
    """Assign the antennas to a chip; the first ones of the chip if their positions differ."""
    array = recording.radar.array
    try:
        (tx, rx), is_board = match_antennas_to_device(array, device), True
    except InvalidSetting:
        tx, rx, is_board = tuple(range(len(array.tx_m))), tuple(range(array.n_rx)), False
    return TiChip(
        device=device,
        lanes=device.lvds_lanes or 2,
        tx=tx,
        rx=rx,
        is_board=is_board,
        iq=recording.contents.iq or "iq",
    )


def _can_fill_word_groups(chip: TiChip, radar: Radar, n_frames: int) -> bool:
    """Return whether the samples fill the groups of the chip."""
    chirp = radar.frame.chirp
    is_complex = chirp.sampling == "complex"
    if chip.lanes == N_LANES:
        return True
    n_words = n_frames * radar.frame.n_chirps_total * radar.array.n_rx * chirp.n_samples
    return chirp.n_samples % 2 == 0 if is_complex else n_words % 4 == 0


def format_cfg_or_reason(recording: Recording, chip: TiChip, bits: int) -> tuple[str | None, str]:
    """Return the text of the `.cfg`; None, and the reason, if the demo cannot be configured so."""
    if bits != CFG_BITS:
        return None, f"its codes have {bits} bits, but those of the demo {CFG_BITS}"
    try:
        text = format_ti_cfg(
            radar_with_frame_period(recording),
            device=chip.device,
            n_frames=frame_count_or_zero_above_limit(recording),
            iq=chip.iq,
        )
    except DechirpError as error:
        return None, "; ".join(f"{mistake.setting}: {mistake.value}" for mistake in error.mistakes)
    return text, ""


def frame_count_or_zero_above_limit(recording: Recording) -> int:
    """Return the number of frames as the chip counts them; 0 means until stopped."""
    return recording.n_frames if recording.n_frames <= _MAX_FRAMES else 0


def radar_with_frame_period(recording: Recording) -> Radar:
    """Return the radar with a frame period, which chip settings need even for a single frame."""
    radar = recording.radar
    if radar.frame.period_s is not None or recording.n_frames > 1:
        return radar
    return replace(radar, frame=replace(radar.frame, period_s=radar.frame.duration_s + _PAUSE_S))
