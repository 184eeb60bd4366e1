"""Antenna positions: those of the device, or assumed ones with a finding."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.checks import check_integer
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device
from dechirp.radar.radar import Radar

_TI_TX_MASK, _TI_RX_MASK = 0b111, 0b1111
"""Antennas of a chip of TI."""
_TI_THREE_TX, _TI_TWO_TX = ((0, 0), (2, 1), (4, 0)), ((0, 0), (4, 0))
"""Columns to the right and rows of the transmitters in half wavelengths, see `devices.ti`."""


def find_device_or_none(name: str) -> Device | None:
    """Return the device with the name in a file; None if it is unknown."""
    try:
        return device(name)
    except InvalidSetting:
        return None


def find_device_of_geometry(
    left: Sequence[float], up: Sequence[float], start_frequency_hz: float
) -> Device | None:
    """Return the device with a virtual array, given as TI's commands `antGeometry0` and 1 do.

    Parameters
    ----------
    left, up : sequence of float
        Positions of the elements in half wavelengths, transmitter by transmitter.
    start_frequency_hz : float
        A frequency within a band of the device.

    Returns
    -------
    The device; None if there is none, or several with the same array.
    """
    geometry = np.array([left, up]) - np.array([left[:1], up[:1]])
    devices = []
    for device_class in Device.members().values():
        candidate = device_class()
        positions_m = Array(tx_m=candidate.tx_m, rx_m=candidate.rx_m).virtual_positions_m[:, 1:].T
        offsets_m = positions_m - positions_m[:, :1]
        if offsets_m.shape != geometry.shape:
            continue
        half_wavelength_m = np.min(abs(offsets_m[abs(offsets_m) > 1e-6]))
        is_equal = np.allclose(offsets_m / half_wavelength_m, geometry, atol=0.01)
        bands_hz = candidate.limits.bands_hz
        if is_equal and any(low <= start_frequency_hz <= high for low, high in bands_hz):
            devices.append(candidate)
    return devices[0] if len(devices) == 1 else None


def device_or_assumed_array(
    chirp: Chirp, *, tx_mask: int, rx_mask: int, device: Device | None, is_ti: bool = False
) -> tuple[Array, tuple[Finding, ...]]:
    """Return the positions of the antennas of two masks, with a finding if they are assumed.

    Parameters
    ----------
    chirp : Chirp
        Its wavelength is the unit of assumed positions.
    tx_mask, rx_mask : int
        A bit for each antenna in use, the lowest for the first of the chip.
    device : Device or None
        Device with the antennas; None if unknown.
    is_ti : bool
        Whether it is a chip of TI: an unknown device is taken for one of its boards with
        receivers in a row, of which the first is leftmost.

    Raises
    ------
    InvalidSetting
        If a mask selects no antenna, or one that the device lacks.
    """
    # More antennas than any chip has: a larger number is not a mask.
    check_integer("tx_mask", tx_mask, at_least=1, at_most=2**16 - 1)
    check_integer("rx_mask", rx_mask, at_least=1, at_most=2**16 - 1)
    if device is not None:
        return device.select_antennas(tx_mask, rx_mask), ()
    n_rx, n_tx = rx_mask.bit_count(), tx_mask.bit_count()
    if is_ti and tx_mask <= _TI_TX_MASK and rx_mask <= _TI_RX_MASK:
        array, layout = _assumed_ti_board(chirp, tx_mask, rx_mask), _describe_ti_board(tx_mask)
    else:
        array = assumed_ula(chirp, n_rx, n_tx, is_ti=is_ti)
        layout = _describe_ula(n_rx, n_tx, "from left to right" if is_ti else "along y")
    return array, (_assumed_positions_note(n_rx, n_tx, layout),) if n_rx * n_tx > 1 else ()


def _assumed_ti_board(chirp: Chirp, tx_mask: int, rx_mask: int) -> Array:
    """Return the antennas in use of a board of TI with a single chip and receivers in a row.

    Boards of chips with three transmitters have the second one raised between the others; those of
    chips with two have the second one in the place of the third.
    """
    half_m = chirp.wavelength_m / 2
    transmitters = _TI_THREE_TX if tx_mask & 0b100 else _TI_TWO_TX
    return Array(
        tx_m=tuple(
            (0.0, -column * half_m, row * half_m)
            for n, (column, row) in enumerate(transmitters)
            if tx_mask >> n & 1
        ),
        rx_m=tuple(
            (0.0, -n * half_m, 0.0) for n in range(rx_mask.bit_length()) if rx_mask >> n & 1
        ),
    )


def _describe_ti_board(tx_mask: int) -> str:
    """Describe the antennas of `_assumed_ti_board`."""
    receivers = "as on boards of TI: receivers half a wavelength apart from left to right"
    transmitters = "the transmitters two wavelengths apart"
    if tx_mask & 0b100:
        transmitters = "TX1 and TX3 two wavelengths apart"
    if tx_mask & 0b110 == 0b110:
        transmitters = f"{transmitters}, TX2 between them and half a wavelength higher"
    return receivers if tx_mask.bit_count() == 1 else f"{receivers}, {transmitters}"


def _describe_ula(n_rx: int, n_tx: int, direction: str) -> str:
    """Describe the antennas of `assumed_ula`."""
    transmitters = f" and {n_rx / 2:g} wavelengths" if n_tx > 1 else ""
    return f"half a wavelength{transmitters} apart {direction}"


def assumed_ula(chirp: Chirp, n_rx: int, n_tx: int = 1, *, is_ti: bool = False) -> Array:
    """Return an assumed array whose virtual array is a uniform linear array of half a wavelength.

    Receivers are half a wavelength apart, transmitters the length of all receivers; from right to
    left, but from left to right for `is_ti`, see `device_or_assumed_array`.
    """
    half_m = chirp.wavelength_m / 2 * (-1 if is_ti else 1)
    return Array(
        tx_m=tuple((0.0, n * n_rx * half_m, 0.0) for n in range(n_tx)),
        rx_m=tuple((0.0, n * half_m, 0.0) for n in range(n_rx)),
    )


def _assumed_positions_note(n_rx: int, n_tx: int, layout: str) -> Finding:
    """Return the note that positions of the given layout are assumed."""
    if n_tx == 1:
        antennas, depend = f"{n_rx} receivers", "which only directions depend on"
    else:
        antennas = f"{n_rx} receivers and {n_tx} transmitters"
        depend = "which directions depend on, and with them the ambiguity numbers of velocities"
    return Finding(
        level="note",
        setting="radar.array.rx" if n_tx == 1 else "radar.array",
        value=f"{antennas} at unknown positions, assumed {layout}",
        expected=f"their true positions, {depend}",
        fix="give the device (--device NAME), or the radar with its array",
    )


def fit_array_to_receiver_count(
    radar: Radar, n_rx: int, *, file: Path
) -> tuple[Radar, tuple[Finding, ...]]:
    """Fit the array to the number of receivers in a recording.

    A radar with the default array gets a uniform linear array, with a finding.

    Raises
    ------
    RecordingError
        If the array was given with another number of receivers.
    """
    if radar.array.n_rx == n_rx:
        return radar, ()
    if radar.array != Array():
        raise RecordingError(
            file,
            value=f"{n_rx} receivers",
            expected=f"{radar.array.n_rx}, the number in radar.array.rx",
            fix="correct radar.array.rx, or the order of the axes",
        )
    return replace(radar, array=assumed_ula(radar.frame.chirp, n_rx)), (
        _assumed_positions_note(n_rx, 1, _describe_ula(n_rx, 1, "along y")),
    )
