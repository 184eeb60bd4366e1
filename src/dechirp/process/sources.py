"""From the amplitudes of a detection in the channels to the directions of its sources."""

from typing import NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.process.angle.aperture import Aperture, FieldOfView, aperture
from dechirp.process.angle.base import DirectionEstimator
from dechirp.process.virtual import element_noise, elements, parts
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.theory.direction_bounds import towards


class Sources(NamedTuple):
    """Sources of all detections, those of each the strongest first; arrays (n_sources,).

    Angles are NaN where none was estimated: a detection has at least one source.
    """

    detection: np.ndarray
    """Which it is of, ascending."""
    share: np.ndarray
    """Of the power of its detection."""
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    azimuth_std_rad: np.ndarray
    elevation_std_rad: np.ndarray


def aperture_of(radar: Radar, field_of_view: FieldOfView) -> Aperture:
    """The virtual array, where it tells directions.

    Raises
    ------
    InvalidSetting
        About `chain.angle`, where its elements share one place across the line of sight, the
        code does not part them, or one round is the frame, so that velocities, by which the
        transmitters turn against each other, are not known.
    """
    got = None
    try:
        found = aperture(radar, field_of_view)
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        if mistake.setting != "Radar.array":
            raise
        got, need = mistake.got, mistake.need
    if not parts(radar.frame):
        n_tx = len(radar.array.tx_m)
        got, need = f"a code of {n_tx} transmitters", "a code that parts them over a round"
    elif radar.frame.n_chirps == 1 < radar.frame.n_slots and len(radar.array.tx_m) > 1:
        got, need = "transmitters that share one round", "two rounds or more, for the velocity"
    if got is not None:
        raise InvalidSetting(
            "chain.angle", got=got, need=need, fix="Set angle to null, or correct the radar."
        )
    return found


def tells_directions(radar: Radar) -> bool:
    """Whether there is anything for a direction estimator to work on."""
    try:
        aperture_of(radar, FieldOfView())
    except InvalidSetting:
        return False
    return True


def undirected(n: int) -> Sources:
    """One source for each of n detections, from nowhere in particular."""
    return Sources(np.arange(n), np.ones(n), *np.full((4, n), np.nan))


def middle_m(
    azimuth_rad: np.ndarray, elevation_rad: np.ndarray, fold: np.ndarray, radar: Radar
) -> np.ndarray:
    """Where ranges and directions of sources are measured from, (n, 3): the middle of the array.

    An angle that is not told counts as 0, as in the steering of an array on a line, and so does
    the middle along its axis. Where no angle is told, or the fold that it takes is not known,
    nothing says what to bring to the origin: 0.
    """
    middle = radar.elements_m.mean(axis=0) / 2
    told = np.stack([np.isfinite(azimuth_rad), np.isfinite(elevation_rad)], axis=-1)
    known = told.any(axis=1) & is_sure(fold, radar.frame)
    axes = np.column_stack([np.ones(len(told), bool), told]) & known[:, None]
    return np.where(axes, middle, 0.0)


def from_origin(
    range_m: np.ndarray, azimuth_rad: np.ndarray, elevation_rad: np.ndarray, middle_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ranges and directions from the origin, (n,) each, of sources seen from elsewhere, (n, 3).

    Angles that are not told stay so, see `middle_m`. Ranges no longer than the way to the origin
    are of leakage and constant offsets: these are at no place, and stay as they are.
    """
    x, y, z = (middle_m + range_m[:, None] * _towards(azimuth_rad, elevation_rad)).T
    is_place = _is_place(range_m, middle_m)
    return (
        np.where(is_place, np.sqrt(x**2 + y**2 + z**2), range_m),
        np.where(is_place & np.isfinite(azimuth_rad), np.arctan2(y, x), azimuth_rad),
        np.where(
            is_place & np.isfinite(elevation_rad), np.arctan2(z, np.hypot(x, y)), elevation_rad
        ),
    )


def range_from_m(
    middle_m: np.ndarray, range_m: np.ndarray, azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> np.ndarray:
    """How far from there sources are that are seen from the origin, (n,): undoes `from_origin`."""
    at_m = range_m[:, None] * _towards(azimuth_rad, elevation_rad) - middle_m
    is_place = _is_place(range_m, middle_m)
    return np.where(is_place, np.linalg.norm(at_m, axis=1), range_m)


def _is_place(range_m: np.ndarray, middle_m: np.ndarray) -> np.ndarray:
    away_m = np.linalg.norm(middle_m, axis=1)
    return np.asarray((away_m > 0) & (range_m > away_m))


def _towards(azimuth_rad: np.ndarray, elevation_rad: np.ndarray) -> np.ndarray:
    return towards(np.nan_to_num(azimuth_rad), np.nan_to_num(elevation_rad))


def is_sure(fold: np.ndarray, frame: Frame) -> np.ndarray:
    """Whether directions are those of a fold that is known, or that needs none, (n,)."""
    return np.asarray(~np.isnan(fold) | (frame.multiplexing is None))


def snapshots(
    amplitudes: np.ndarray, doppler_hz: np.ndarray, noise_power: np.ndarray, radar: Radar
) -> tuple[np.ndarray, np.ndarray]:
    """What the virtual elements hear, (n, 1, n_elements), and the noise in one of them, (n,).

    From amplitudes in the channels, see `sources`: motion and code undone, calibrated. Slots of
    one transmitter are brought in phase by themselves: no fold turns its elements.
    """
    if radar.frame.multiplexing is None:
        heard = _in_phase(amplitudes, radar.frame.n_slots)
    else:
        heard = elements(amplitudes, radar.frame, doppler_hz)
    heard = heard * radar.element_gain
    noise = noise_power * element_noise(radar.frame) * np.mean(np.abs(radar.element_gain) ** 2)
    return heard[:, None], np.asarray(noise)


def _in_phase(amplitudes: np.ndarray, n_slots: int) -> np.ndarray:
    """Mean of the slots, (n, n_rx), turned by the phases that add up to the most."""
    if n_slots == 1:
        return amplitudes
    by_slot = amplitudes.reshape(len(amplitudes), n_slots, -1)
    alike = by_slot @ by_slot.conj().swapaxes(1, 2)
    turns = np.linalg.eigh(alike).eigenvectors[:, :, -1].conj()
    return np.asarray(np.einsum("nl,nlr->nr", turns, by_slot) / np.sqrt(n_slots))


def sources(
    amplitudes: np.ndarray,
    doppler_hz: np.ndarray,
    noise_power: np.ndarray,
    radar: Radar,
    estimator: DirectionEstimator,
    seen: Aperture,
) -> Sources:
    """Directions of n detections.

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx), complex
        Of the channels, see `process.virtual.channels`.
    doppler_hz : array (n,)
        Unfolded as far as is known: the motion between slots that is undone.
    noise_power : array (n,)
        E|w|^2 in one amplitude of a channel.
    radar, estimator, seen
        Whose they are, and how directions are looked for.
    """
    heard, noise = snapshots(amplitudes, doppler_hz, noise_power, radar)
    found = estimator.directions(heard, seen, noise)
    is_there = np.isfinite(found.azimuth_rad) | np.isfinite(found.elevation_rad)
    is_there[:, 0] = True
    detection, place = np.nonzero(is_there)
    power = np.where(np.isfinite(found.power), found.power, 0.0)
    whole = power.sum(axis=1, keepdims=True)
    share = np.where(whole > 0, power / np.where(whole > 0, whole, 1.0), 1.0)
    return Sources(
        detection, share[detection, place], *(angle[detection, place] for angle in found[:4])
    )
