"""Calibration of an array from a corner reflector at known angles."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import listed, number
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT, decibels
from dechirp.core.values import value
from dechirp.process.calibration.doubts import doubts, element_name
from dechirp.process.calibration.element_errors import ElementErrors, element_errors
from dechirp.process.calibration.reflector import reflector
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar

Frames = xr.DataArray | Iterable[xr.DataArray]
"""A cube, or its frames one by one as `Recording.frames` gives them."""

_DEAF = 10.0  # of signal over noise: a tenth of the phases is more than 13 degrees off


@value
class Calibrated:
    """A calibration that was measured, and how well."""

    calibration: Calibration
    snr: tuple[float, ...]
    """Of the reflector in each element, noise after range and Doppler processing, a ratio."""
    gain_std: tuple[float, ...]
    """Standard error of each gain by the noise, relative: of its magnitude, and of its phase in
    radians."""
    position_std_m: tuple[tuple[float, float, float], ...]
    """Standard errors of the positions by the noise; 0 along axes that were not estimated."""
    range_m: tuple[float, ...]
    """Where the reflector was seen in each recording, the mean over its frames, uncalibrated."""
    findings: tuple[Finding, ...]
    """What makes the calibration doubtful."""


def calibrate(
    cubes: Frames | Sequence[Frames],
    radar: Radar,
    *,
    azimuth_rad: float | Sequence[float],
    elevation_rad: float | Sequence[float] = 0.0,
    range_m: float | Sequence[float] | None = None,
) -> Calibrated:
    """Gain and phase of each virtual element from a corner reflector at a known direction.

    The reflector stands still. From several recordings of it, at angles that differ, the
    positions of the elements are estimated as well, along y, and along z where elevations
    differ. Waves are taken as spherical at the range that is given or measured, so that the
    reflector may stand near: at 2 m, antennas 15 mm aside see a wave of 77 GHz bent by 5 degrees.

    Parameters
    ----------
    cubes : DataArray (frame, chirp, rx, sample) or its frames one by one
        One recording with the reflector; a sequence of them where `azimuth_rad` is one.
    radar : Radar
        What they were recorded with. Of a calibration it already has, the position errors
        are what new ones are counted from, and the range offset stays where no range is
        given; its gains are left aside.
    azimuth_rad : float or sequence of float
        Where the reflector stands, of each recording; left positive.
    elevation_rad : float or sequence of float
        Up positive; one for all, or one for each.
    range_m : float or sequence of float, optional
        How far it stands from the origin of the antennas; one for all, or one for each. The
        strongest echo at rest near it is taken, and the range offset follows. Without it: the
        strongest beyond the first three range cells, and no new offset.

    Raises
    ------
    InvalidSetting
        If the radar has one element or ramps that differ, an angle is beyond 90 degrees, no
        echo at rest is found there, an element does not hear it 10 dB over the noise, or counts
        do not agree.

    Notes
    -----
    `process.calibration.element_errors` says what cannot be told apart. The residual is what is
    left after correction at the angles used; one angle in one frame has no surplus of numbers,
    so that it is the noise alone. It is not the error at other angles: channels that differ
    from angle to angle, by patterns and coupling, show where several angles were used.
    """
    _must_be_an_array(radar)
    placed = _placed(cubes, azimuth_rad, elevation_rad, range_m)
    bare = replace(radar, calibration=None)
    seen, of = [], []
    for place, one in enumerate(placed):
        for index, frame in enumerate(_one_by_one(one.frames)):
            seen.append(reflector(frame, bare.at(index), one.range_m))
            of.append(place)
    recording = np.array(of)
    seen_m = np.bincount(recording, [look.range_m for look in seen]) / np.bincount(recording)
    told_m = np.array([np.nan if one.range_m is None else one.range_m for one in placed])
    given = np.isfinite(told_m)
    at_m = np.where(given, told_m, seen_m)
    towards = np.array([one.towards for one in placed])
    ways_m = _ways_m(radar, at_m[:, None] * towards)
    snr = np.min([abs(look.snapshot) ** 2 / look.noise_power for look in seen], axis=0)
    _must_hear(snr, radar)
    errors = element_errors(
        np.array([look.snapshot for look in seen]),
        np.array([look.noise_power for look in seen]),
        _believed(ways_m, at_m, towards, radar)[recording],
        towards[recording],
        _wavelength_m(radar),
    )
    offsets_m = (seen_m - ways_m.mean(axis=1) / 2)[given]
    return Calibrated(
        calibration=_calibration(errors, radar, offsets_m),
        snr=tuple(snr.tolist()),
        gain_std=tuple(errors.channel_std.tolist()),
        position_std_m=tuple(map(tuple, errors.position_std_m.tolist())),
        range_m=tuple(seen_m.tolist()),
        findings=doubts(seen, recording, given, towards, errors, snr, radar, _wavelength_m(radar)),
    )


class _Placed(NamedTuple):
    """A recording, and where the reflector stands in it."""

    frames: Frames
    towards: np.ndarray
    """Unit vector, (3,)."""
    range_m: float | None


def _placed(
    cubes: Frames | Sequence[Frames], azimuth_rad: Any, elevation_rad: Any, range_m: Any
) -> list[_Placed]:
    """The recordings, each with what was said of it."""
    given = listed(azimuth_rad)
    recordings: list[Any] = [cubes] if given is None else list(cubes)
    azimuths = (azimuth_rad,) if given is None else given
    if len(recordings) != len(azimuths) or not recordings:
        raise InvalidSetting(
            "azimuth_rad",
            got=f"{len(azimuths)} angles for {len(recordings)} recordings",
            need="one angle for each recording",
            fix="Give them in the same order.",
        )
    n = len(recordings)
    right = {"at_least": -np.pi / 2, "at_most": np.pi / 2}
    elevations = _for_each("elevation_rad", elevation_rad, n)
    ranges = _for_each("range_m", range_m, n)
    return [
        _Placed(
            recordings[place],
            _towards(
                number(_place("azimuth_rad", place, n), azimuths[place], **right),
                number(_place("elevation_rad", place, n), elevations[place], **right),
            ),
            None
            if ranges[place] is None
            else number(_place("range_m", place, n), ranges[place], above=0.0),
        )
        for place in range(n)
    ]


def _place(name: str, place: int, of: int) -> str:
    return name if of == 1 else f"{name}.{place}"


def _for_each(where: str, given: Any, n: int) -> tuple[Any, ...]:
    members = listed(given)
    if members is None:
        return (given,) * n
    if len(members) != n:
        raise InvalidSetting(
            where,
            got=f"{len(members)} numbers for {n} recording{'s' * (n != 1)}",
            need="one for all recordings, or one for each",
            fix="Give them in the order of the recordings.",
        )
    return members


def _one_by_one(frames: Frames) -> Iterator[xr.DataArray]:
    if not isinstance(frames, xr.DataArray):
        yield from frames
        return
    for index in range(frames.sizes["frame"]):
        yield frames.isel(frame=slice(index, index + 1))


def _wavelength_m(radar: Radar) -> float:
    return SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz


def _towards(azimuth: float, elevation: float) -> np.ndarray:
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def _ways_m(radar: Radar, at_m: np.ndarray) -> np.ndarray:
    """From each transmitter over each place to each receiver, (n_places, n_elements)."""
    there = np.linalg.norm(at_m[:, None] - np.array(radar.array.tx_m), axis=-1)
    back = np.linalg.norm(at_m[:, None] - np.array(radar.array.rx_m), axis=-1)
    return np.asarray((there[:, :, None] + back[:, None]).reshape(len(at_m), -1))


def _believed(
    ways_m: np.ndarray, at_m: np.ndarray, towards: np.ndarray, radar: Radar
) -> np.ndarray:
    """What elements of equal channels see of a reflector so far away, (n_places, n_elements)."""
    errors_m = radar.elements_m - radar.array.virtual_m
    longer_m = ways_m - 2 * at_m[:, None] - towards @ errors_m.T
    return np.exp(2j * np.pi / _wavelength_m(radar) * longer_m)


def _calibration(errors: ElementErrors, radar: Radar, offsets_m: np.ndarray) -> Calibration:
    gain = 1 / errors.channel
    gain *= np.exp(-1j * np.angle(gain.sum())) / abs(gain).mean()
    before, n_rx = radar.calibration, radar.array.n_rx
    position_error_m = radar.elements_m - radar.array.virtual_m + errors.position_m
    known = position_error_m.any() or (before is not None and before.position_error_m is not None)
    offset_m = 0.0 if before is None else before.range_offset_m
    return Calibration(
        elements=tuple((index // n_rx, index % n_rx) for index in range(radar.n_channels)),
        gain=tuple((float(one.real), float(one.imag)) for one in gain),
        position_error_m=tuple(map(tuple, position_error_m.tolist())) if known else None,
        range_offset_m=float(offsets_m.mean()) if offsets_m.size else offset_m,
        residual=errors.residual,
    )


def _must_be_an_array(radar: Radar) -> None:
    if radar.n_channels < 2:
        raise InvalidSetting(
            "radar.array",
            got="of one transmitter and one receiver",
            need="of several elements, which are compared with each other",
            fix="Calibrate the array that tells directions; one element has none to correct.",
        )
    if radar.frame.modulation is not None:
        raise InvalidSetting(
            "radar.frame.modulation",
            got=radar.frame.modulation.kind(),
            need="none: the ramps of a calibration are alike",
            fix="Record the reflector with one ramp; gains and places hold for the others, too.",
        )


def _must_hear(snr: np.ndarray, radar: Radar) -> None:
    if snr.min() >= _DEAF:
        return
    deaf = [element_name(index, radar) for index in np.flatnonzero(snr < _DEAF).tolist()]
    raise InvalidSetting(
        "cube",
        got=f"with the reflector {float(decibels(max(snr.min(), 1e-30))):.1f} dB over the noise in"
        f" element {deaf[0]}" + (f" and few more in {len(deaf) - 1} others" if deaf[1:] else ""),
        need="of 10 dB or more in each element: a gain would raise noise",
        fix="Record it nearer, for longer or larger; leave an antenna that is dead out of the"
        " array.",
    )
