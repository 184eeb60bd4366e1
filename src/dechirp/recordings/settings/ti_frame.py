"""Frame settings common to all settings files of TI radars: chirps, transmitter masks, loops."""

import functools
import math
import operator
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.array import Array
from dechirp.radar.calibration import Calibration
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.base import Multiplexing
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.antenna_positions import (
    device_or_assumed_array,
    find_device_or_none,
)
from dechirp.recordings.settings.base import Iq, RecordingSettings

MAX_CHIRPS = 512
"""Number of chirps that the chip can store before they repeat."""

BITS = {0: 12, 1: 14, 2: 16}
"""ADC bits, by the chip's code for them."""

CHIRP_PHASES = re.compile(r"bpm|phase_?shift", re.IGNORECASE)
"""Names of calls that set the phases of transmitters chirp by chirp."""

_MERGED_FRAME_S = 0.3  # in which a person walks 0.2 m, see `join_single_chirps`
_MIN_MERGED, _MAX_MERGED = 8, 256


@frozen_dataclass
class TiFrame:
    """Equal chirps, and their transmitters."""

    chirp: Chirp
    interval_s: float
    masks: tuple[int, ...]
    """Transmitters of each chirp of a loop, a bit each, the lowest for the first."""
    n_loops: int
    n_frames: int
    """Number of frames; 0 means until stopped."""
    period_s: float
    rx_mask: int
    inverted_masks: tuple[int, ...] = ()
    """Transmitters of each chirp of a loop with the opposite sign, a bit each; none if empty."""
    is_sub_frame: bool = False
    """Whether other chirps follow before the next frame."""
    round_pause_s: float = 0.0
    """Pause before the first chirp of each loop, beside the interval; a loop is one round then."""


@frozen_dataclass
class TiCode:
    """Sharing of the chirps of a loop among transmitters."""

    tx_mask: int
    """Transmitters that send, a bit each."""
    multiplexing: Multiplexing | None = None
    n_slots: int = 1
    """Number of chirps of a round."""
    is_beam: bool = False
    """Whether several transmitters send in every chirp with equal signs, as one antenna."""


def tdm_transmitter_order(masks: Sequence[int]) -> tuple[int, ...]:
    """Return the transmitters of one TDM round, from 0, in the order in which they send.

    Parameters
    ----------
    masks : sequence of int
        Transmitters of each chirp of a loop: a single one, or rounds of several.

    Raises
    ------
    InvalidSetting
        If a chirp has none or several, or the loop does not consist of equal rounds.
    """
    for index, mask in enumerate(masks):
        if mask > 0 and mask.bit_count() == 1:
            continue
        problem = f"chirp {index} with transmitters {_format_transmitters_of_mask(mask)} at once"
        raise InvalidSetting(
            "transmitters",
            value=problem if mask > 0 else f"chirp {index} without transmitter",
            expected="one transmitter in each chirp",
            fix="record with transmitters that take turns, or give the radar as a YAML file with"
            " multiplexing of kind bpm, ddma or phase-code",
        )
    one_round = tuple(dict.fromkeys(masks))
    n_rounds, rest = divmod(len(masks), len(one_round))
    if rest or tuple(masks) != one_round * n_rounds:
        order_text = " ".join(_format_transmitters_of_mask(mask) for mask in masks[:16])
        raise InvalidSetting(
            "transmitters",
            value=f"the order {order_text}{' ...' if len(masks) > 16 else ''}",
            expected="equal rounds, with each transmitter once in a round",
            fix="record with transmitters that take turns, chirp by chirp",
        )
    return tuple(mask.bit_length() - 1 for mask in one_round)


def ti_code(masks: Sequence[int], inverted_masks: Sequence[int] = ()) -> TiCode:
    """Return the code of the chirps of a loop.

    Parameters
    ----------
    masks, inverted_masks : sequence of int
        Transmitters of each chirp, and those of them with the opposite sign; see `TiFrame`.

    Raises
    ------
    InvalidSetting
        If the transmitters can be separated neither by turns nor by their signs, unless all send
        together in each chirp, as one antenna.
    """
    tx_mask = functools.reduce(operator.or_, masks, 0)
    if not any(inverted_masks) and {*masks} == {tx_mask} and tx_mask.bit_count() > 1:
        return TiCode(tx_mask=tx_mask, is_beam=True)
    if min(masks) <= 0 or (not any(inverted_masks) and all(n.bit_count() == 1 for n in masks)):
        order = tdm_transmitter_order(masks)
        transmitters = sorted(order)
        # The array has the transmitters that send, in the chip's order.
        indices = tuple(transmitters.index(transmitter) for transmitter in order)
        multiplexing = Tdm(order=indices) if len(order) > 1 else None
        return TiCode(tx_mask=tx_mask, multiplexing=multiplexing, n_slots=len(order))
    transmitters = list(_mask_to_indices(tx_mask))
    signs = inverted_masks or (0,) * len(masks)
    rows: list[tuple[float | None, ...]] = [
        tuple(
            (math.pi if inverted >> tx & 1 else 0.0) if mask >> tx & 1 else None
            for tx in transmitters
        )
        for mask, inverted in zip(masks, signs, strict=True)
    ]
    n_slots = next(
        n
        for n in range(1, len(rows) + 1)
        if len(rows) % n == 0 and rows == rows[:n] * (len(rows) // n)
    )
    rows = rows[:n_slots]
    # As in the files of TI: the demo sends + +, then + -.
    bpm = rows == [(0.0, 0.0), (0.0, math.pi)]
    code = Bpm(order=(0, 1)) if bpm else PhaseCode(phases_rad=tuple(rows))
    if code.non_orthogonal_pairs:
        pairs = ", ".join(
            f"{transmitters[first] + 1} and {transmitters[second] + 1}"
            for first, second in code.non_orthogonal_pairs
        )
        together = next(mask for mask in masks if mask.bit_count() > 1)
        raise InvalidSetting(
            "transmitters",
            value=f"a chirp with transmitters {_format_transmitters_of_mask(together)} at once, in"
            f" a loop of {len(masks)} chirps whose signs do not separate {pairs}",
            expected="transmitters that take turns, signs that separate them, or all of them"
            " together in every chirp",
            fix="record so, or give the radar as a YAML file with multiplexing of kind bpm, ddma or"
            " phase-code",
        )
    return TiCode(tx_mask=tx_mask, multiplexing=code, n_slots=n_slots)


def ti_frame_to_recording_settings(
    ti_frame: TiFrame,
    *,
    iq: Iq | None,
    interleaved: bool | None,
    bits: int,
    chip_name: str,
    device: Device | None,
) -> RecordingSettings:
    """Convert the settings of a TI chip to those of a recording.

    A frame of one chirp has no slow time. Consecutive frames of one chirp are merged into one
    frame, with a finding.

    Parameters
    ----------
    ti_frame : TiFrame
        The frame.
    iq, interleaved, bits
        See `RecordingSettings`.
    chip_name : str
        Name of the chip in the file; empty without one.
    device : Device or None
        Device given by the user, which has priority over the name.

    Raises
    ------
    InvalidSetting
        If the frame is impossible.
    """
    known_device = device or find_device_or_none(chip_name)
    code = ti_code(ti_frame.masks, ti_frame.inverted_masks)
    n_chirps = ti_frame.n_loops * (len(ti_frame.masks) // code.n_slots)
    tx_mask = code.tx_mask
    array, findings = device_or_assumed_array(
        ti_frame.chirp, tx_mask=tx_mask, rx_mask=ti_frame.rx_mask, device=known_device, is_ti=True
    )
    calibration = (
        None if known_device is None else known_device.sign_calibration(tx_mask, ti_frame.rx_mask)
    )
    if code.is_beam:
        array, calibration, note = _join_transmitters(array, calibration, tx_mask)
        findings += (note,)
    is_merged = (
        n_chirps == code.n_slots == 1 and not ti_frame.is_sub_frame and ti_frame.n_frames != 1
    )
    if is_merged:
        n_merged = _count_merged_frames(ti_frame)
        frame = Frame(chirp=ti_frame.chirp, n_chirps=n_merged, interval_s=ti_frame.period_s)
        findings += (_merged_frames_note(frame, ti_frame.n_frames),)
    else:
        frame = Frame(
            chirp=ti_frame.chirp,
            n_chirps=n_chirps,
            interval_s=ti_frame.interval_s,
            period_s=ti_frame.period_s,
            multiplexing=_with_pause(code, ti_frame),
        )
    return RecordingSettings(
        radar=Radar(frame=frame, array=array, calibration=calibration),
        iq=iq if ti_frame.chirp.sampling == "complex" else None,
        n_frames=(ti_frame.n_frames // frame.n_chirps if is_merged else ti_frame.n_frames) or None,
        has_merged_frames=is_merged,
        is_interleaved=interleaved,
        bits=bits,
        receivers=tuple(
            n for n in range(ti_frame.rx_mask.bit_length()) if ti_frame.rx_mask >> n & 1
        ),
        device=None if known_device is None else known_device.kind(),
        findings=findings,
    )


def _with_pause(code: TiCode, ti_frame: TiFrame) -> Multiplexing | None:
    """Return the multiplexing with the pause of a loop; raise `InvalidSetting` if it has none."""
    if not ti_frame.round_pause_s:
        return code.multiplexing
    if not isinstance(code.multiplexing, Tdm) or code.n_slots < len(ti_frame.masks):
        raise InvalidSetting(
            "transmitters",
            value="a pause before each loop",
            expected="one chirp of each of several transmitters in a loop",
            fix="record chirps with equal idle times; others are not supported yet",
        )
    return replace(code.multiplexing, pause_s=ti_frame.round_pause_s)


def _join_transmitters(
    array: Array, calibration: Calibration | None, tx_mask: int
) -> tuple[Array, Calibration | None, Finding]:
    """Join transmitters that send together to one at their centre; return it with a note.

    Directions of the receivers do not depend on the phases of the transmitters, since each
    receiver measures the sum of the same waves.
    """
    x, y, z = np.mean(array.tx_m, axis=0).tolist()
    if calibration is not None:
        n_rx = len(array.rx_m)
        calibration = Calibration(
            elements=calibration.elements[:n_rx], gain=calibration.gain[:n_rx]
        )
    note = Finding(
        level="note",
        setting="radar.array.tx",
        value=f"transmitters {_format_transmitters_of_mask(tx_mask)} together in every chirp, read"
        " as one antenna at their centre",
        expected="echoes in the beam of these transmitters, whose gain depends on the direction",
        fix="no action needed",
    )
    return Array(tx_m=((x, y, z),), rx_m=array.rx_m), calibration, note


def _mask_to_indices(mask: int) -> tuple[int, ...]:
    """Return the indices of the bits of a mask."""
    return tuple(n for n in range(mask.bit_length()) if mask >> n & 1)


def _format_transmitters_of_mask(mask: int) -> str:
    """Format the transmitters of a mask, from 1."""
    return "+".join(str(n + 1) for n in _mask_to_indices(mask)) or "none"


def _count_merged_frames(ti_frame: TiFrame) -> int:
    """Return the number of frames of one chirp that become one: about 0.3 s, from 8 to 256 chirps.

    Of these numbers, from the largest to half of it, the one that leaves out the fewest chirps.
    """
    n_most = int(np.clip(_MERGED_FRAME_S / ti_frame.period_s, _MIN_MERGED, _MAX_MERGED))
    if not ti_frame.n_frames:  # until it is stopped
        return 2 ** int(math.log2(n_most))
    if ti_frame.n_frames <= n_most:
        return ti_frame.n_frames
    numbers = range(n_most, max(n_most // 2, _MIN_MERGED - 1), -1)
    return min(numbers, key=lambda number: ti_frame.n_frames % number)


def _merged_frames_note(frame: Frame, n_frames: int) -> Finding:
    """Return the note that frames of one chirp were merged; `n_frames` 0 is without end."""
    n_chirps, interval_s = frame.n_chirps, frame.repetition_s
    limit_m_per_s = frame.chirp.wavelength_m / 4 / interval_s
    total = f"{n_frames} frames" if n_frames else "frames"
    return Finding(
        level="note",
        setting="radar.frame.n_chirps",
        value=f"chosen --set radar.frame.n_chirps={n_chirps} because frames of one chirp have no"
        f" velocity: {total} of one chirp, {interval_s * 1e3:g} ms apart, merged; velocities beyond"
        f" {limit_m_per_s:.3g} m/s are aliased",
        expected="several chirps in a frame, to measure velocity",
        fix="give another number of 2 chirps or more: longer frames resolve slower motion, and"
        " smear targets that change their velocity or range cell",
    )
