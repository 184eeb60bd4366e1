"""Where the antennas are: as the device has them, or assumed when nobody said."""

from dataclasses import replace
from pathlib import Path

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.known import device
from dechirp.radar.radar import Radar


def known(name: str) -> Device | None:
    """Device of a name that a file gives; None where none is known by it."""
    try:
        return device(name)
    except InvalidSetting:
        return None


def antennas(
    chirp: Chirp, *, tx_mask: int, rx_mask: int, of: Device | None
) -> tuple[Array, tuple[Finding, ...]]:
    """Positions of the antennas of two masks, and a finding where they are a guess.

    Parameters
    ----------
    chirp : Chirp
        Its wavelength is the unit of the guess.
    tx_mask, rx_mask : int
        A bit for each antenna that is used, the lowest for the chip's first.
    of : Device or None
        Whose antennas they are; None where nobody knows.

    Raises
    ------
    InvalidSetting
        If a mask names no antenna, or one that the device has not.
    """
    # More than any chip has: beyond, it is no mask.
    whole("tx_mask", tx_mask, at_least=1, at_most=2**16 - 1)
    whole("rx_mask", rx_mask, at_least=1, at_most=2**16 - 1)
    if of is not None:
        return of.part(tx_mask, rx_mask), ()
    n_rx, n_tx = rx_mask.bit_count(), tx_mask.bit_count()
    found = (assumed(n_rx, n_tx),) if n_rx * n_tx > 1 else ()
    return assumed_line(chirp, n_rx, n_tx), found


def assumed_line(chirp: Chirp, n_rx: int, n_tx: int = 1) -> Array:
    """Antennas on a line whose virtual array is a line, half a wavelength apart.

    Receivers are half a wavelength apart, and transmitters as far as all receivers reach.
    """
    half_m = chirp.wavelength_m / 2
    return Array(
        tx_m=tuple((0.0, n * n_rx * half_m, 0.0) for n in range(n_tx)),
        rx_m=tuple((0.0, n * half_m, 0.0) for n in range(n_rx)),
    )


def assumed(n_rx: int, n_tx: int = 1) -> Finding:
    """Say that the positions are a guess."""
    if n_tx == 1:
        got = f"{n_rx} receivers at positions that no file gives, taken half a wavelength apart"
    else:
        got = (
            f"{n_rx} receivers and {n_tx} transmitters at positions that no file gives, taken"
            f" half a wavelength and {n_rx / 2:g} wavelengths apart"
        )
    return Finding(
        level="note",
        setting="radar.array.rx" if n_tx == 1 else "radar.array",
        got=f"{got} along y",
        need="their true positions, for directions only; range and velocity do not use them",
        fix="Give the device (--device NAME), or the radar with its array.",
    )


def with_receivers(radar: Radar, n_rx: int, *, file: Path) -> tuple[Radar, tuple[Finding, ...]]:
    """Fit the array to the receivers a recording holds.

    A radar whose array was left at its default gets a line of receivers, and a finding
    that says so.

    Raises
    ------
    RecordingError
        If the array was given, with another number of receivers.
    """
    if radar.array.n_rx == n_rx:
        return radar, ()
    if radar.array != Array():
        raise RecordingError(
            file,
            got=f"of {n_rx} receivers",
            need=f"of {radar.array.n_rx}, as many as radar.array.rx has",
            fix="Correct radar.array.rx, or the order of the axes.",
        )
    return replace(radar, array=assumed_line(radar.frame.chirp, n_rx)), (assumed(n_rx),)
