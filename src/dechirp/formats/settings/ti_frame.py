"""What every settings file of a TI radar says, in whatever words: chirps by mask, in loops."""

from collections.abc import Sequence

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.settings.receivers import antennas, known
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.base import Multiplexing
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar

MOST_CHIRPS = 512
"""Chirps for which the chip has room, before they repeat."""

BITS = {0: 12, 1: 14, 2: 16}
"""Bits of the converter, by the chip's code for them."""


@value
class TiFrame:
    """Equal chirps, and which transmitters send them."""

    chirp: Chirp
    interval_s: float
    masks: tuple[int, ...]
    """Transmitters of each chirp of a loop, a bit each, the lowest for the first."""
    n_loops: int
    n_frames: int
    """0: until stopped."""
    period_s: float
    rx_mask: int
    bpm: bool = False
    """Whether the loop is two chirps of the same two transmitters, + + and then + -."""


def turns(masks: Sequence[int]) -> tuple[int, ...]:
    """Give the transmitters of one round, counted from 0, in the order in which they send.

    Parameters
    ----------
    masks : sequence of int
        Transmitters of each chirp of a loop: one alone, or rounds of several.

    Raises
    ------
    InvalidSetting
        If a chirp has none or several, or the loop is not made of equal rounds.
    """
    for index, mask in enumerate(masks):
        if mask > 0 and mask.bit_count() == 1:
            continue
        several = f"chirp {index} with transmitters {_named(mask)} at once"
        raise InvalidSetting(
            "transmitters",
            got=several if mask > 0 else f"chirp {index} with none",
            need="one in every chirp",
            fix="Record with transmitters that take turns, or give the radar as a YAML file with"
            " multiplexing of kind bpm, ddma or phase-code.",
        )
    one_round = tuple(dict.fromkeys(masks))
    n_rounds, rest = divmod(len(masks), len(one_round))
    if rest or tuple(masks) != one_round * n_rounds:
        said = " ".join(_named(mask) for mask in masks[:16])
        raise InvalidSetting(
            "transmitters",
            got=f"in the order {said}{' ...' if len(masks) > 16 else ''}",
            need="in equal rounds, each of them once in a round",
            fix="Record with transmitters that take turns, chirp by chirp.",
        )
    return tuple(mask.bit_length() - 1 for mask in one_round)


def ti_settings(
    sent: TiFrame,
    *,
    iq: Iq | None,
    interleaved: bool,
    bits: int,
    named: str,
    device: Device | None,
) -> Settings:
    """Settings of a recording, from what a TI chip was told.

    A frame of one chirp has no slow time. Such frames, sent one after the other, are
    taken as the chirps of one frame, and a finding says so.

    Parameters
    ----------
    sent : TiFrame
        The frame.
    iq, interleaved, bits
        See `Settings`.
    named : str
        The chip's name in the file; empty where it has none.
    device : Device or None
        What the user said it is; it comes before the name.

    Raises
    ------
    InvalidSetting
        If the frame cannot be.
    """
    found = device or known(named)
    order = _sending(sent.masks[0]) if sent.bpm else turns(sent.masks)
    transmitters = sorted(order)
    # The array has the transmitters that send, in the chip's order.
    places = tuple(transmitters.index(transmitter) for transmitter in order)
    n_chirps = sent.n_loops * (len(sent.masks) // len(order))
    multiplexing: Multiplexing | None = Tdm(order=places) if len(order) > 1 else None
    if sent.bpm:
        multiplexing = Bpm(order=places)
    array, findings = antennas(
        sent.chirp,
        tx_mask=sum(1 << transmitter for transmitter in order),
        rx_mask=sent.rx_mask,
        of=found,
    )
    merged = n_chirps == len(order) == 1 and sent.n_frames > 0
    if merged:
        frame = Frame(chirp=sent.chirp, n_chirps=sent.n_frames, interval_s=sent.period_s)
        findings += (_one_chirp_a_frame(sent.n_frames, sent.period_s),)
    else:
        frame = Frame(
            chirp=sent.chirp,
            n_chirps=n_chirps,
            interval_s=sent.interval_s,
            period_s=sent.period_s,
            multiplexing=multiplexing,
        )
    return Settings(
        radar=Radar(frame=frame, array=array),
        iq=iq if sent.chirp.sampling == "complex" else None,
        n_frames=1 if merged else sent.n_frames or None,
        merged=merged,
        interleaved=interleaved,
        bits=bits,
        receivers=tuple(n for n in range(sent.rx_mask.bit_length()) if sent.rx_mask >> n & 1),
        device=None if found is None else found.kind(),
        findings=findings,
    )


def _sending(mask: int) -> tuple[int, ...]:
    return tuple(n for n in range(mask.bit_length()) if mask >> n & 1)


def _named(mask: int) -> str:
    return "+".join(str(n + 1) for n in _sending(mask)) or "none"


def _one_chirp_a_frame(n_frames: int, period_s: float) -> Finding:
    return Finding(
        level="note",
        setting="radar.frame.n_chirps",
        got=f"{n_frames} frames of one chirp, read as one frame of {n_frames} chirps,"
        f" {period_s * 1e3:g} ms apart",
        need="several chirps in a frame, to measure velocity",
        fix="Give the radar with another number of chirps to divide them otherwise.",
    )
