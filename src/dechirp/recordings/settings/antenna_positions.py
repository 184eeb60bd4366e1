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
        Whether it is a chip of TI: on its boards with receivers in a row, the first is leftmost.

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
    findings = (assumed_positions_note(n_rx, n_tx, is_ti=is_ti),) if n_rx * n_tx > 1 else ()
    return assumed_ula(chirp, n_rx, n_tx, is_ti=is_ti), findings


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


def assumed_positions_note(n_rx: int, n_tx: int = 1, *, is_ti: bool = False) -> Finding:
    """Return the note that the positions are assumed."""
    if n_tx == 1:
        description = f"{n_rx} receivers at unknown positions, assumed half a wavelength apart"
    else:
        description = (
            f"{n_rx} receivers and {n_tx} transmitters at unknown positions, assumed half a"
            f" wavelength and {n_rx / 2:g} wavelengths apart"
        )
    return Finding(
        level="note",
        setting="radar.array.rx" if n_tx == 1 else "radar.array",
        value=f"{description} {'from left to right, as on boards of TI' if is_ti else 'along y'}",
        expected="their true positions, which only directions depend on",
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
        assumed_positions_note(n_rx),
    )
