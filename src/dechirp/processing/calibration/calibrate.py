"""Calibration of an array from a corner reflector at known angles."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import as_tuple_or_none, check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.processing.calibration.element_errors import ElementErrors, fit_element_errors
from dechirp.processing.calibration.findings import (
    calibration_findings,
    describe_direction_mismatch,
    element_tx_rx_label,
)
from dechirp.processing.calibration.reflector import MeasuredReflector, measure_static_reflector
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar

Frames = xr.DataArray | Iterable[xr.DataArray]
"""A cube, or an iterable of its frames as from `Recording.frames`."""

_MIN_SNR = 10.0  # a tenth of the phases is more than 13 degrees off


@frozen_dataclass
class CalibrationResult:
    """A measured calibration and its accuracy."""

    calibration: Calibration
    snr: tuple[float, ...]
    """SNR of the reflector in each element after range and Doppler processing, a ratio."""
    gain_std: tuple[float, ...]
    """Standard error of each gain by the noise, relative: of its magnitude, and of its phase in
    radians."""
    position_std_m: tuple[tuple[float, float, float], ...]
    """Standard errors of the positions by the noise; 0 along axes that were not estimated."""
    range_m: tuple[float, ...]
    """Measured range of the reflector in each recording, the mean over its frames, uncalibrated."""
    findings: tuple[Finding, ...]
    """Findings that put the calibration in doubt."""


@check_argument_types
def calibrate(
    cubes: Frames | Sequence[Frames],
    radar: Radar,
    *,
    azimuth_rad: float | Sequence[float],
    elevation_rad: float | Sequence[float] = 0.0,
    range_m: float | Sequence[float] | None = None,
) -> CalibrationResult:
    """Estimate gain and phase of each virtual element from a corner reflector at a known direction.

    The reflector is static. Several recordings at different angles also determine the positions of
    the elements, along y, and along z where elevations differ. Waves are spherical at the given or
    measured range, so the reflector may be near: at 2 m, the wavefront curvature at 77 GHz is 5
    degrees for antennas 15 mm off the centre.

    Parameters
    ----------
    cubes : DataArray (frame, chirp, rx, sample) or its frames one by one
        One recording with the reflector; a sequence of them where `azimuth_rad` is one.
    radar : Radar
        Radar of the recordings. Of an existing calibration, new position errors add to the old
        ones, and the range offset is kept if no range is given; its gains are ignored.
    azimuth_rad : float or sequence of float
        Azimuth of the reflector in each recording; left positive.
    elevation_rad : float or sequence of float
        Elevation, up positive; one for all, or one for each recording.
    range_m : float or sequence of float, optional
        Range of the reflector from the origin of the antennas; one for all, or one for each. The
        strongest static echo near it is used, and the range offset follows. Without it: the
        strongest beyond the first three range cells, and no new offset.

    Raises
    ------
    InvalidSetting
        If the radar has one element or ramps that differ, an angle is beyond 90 degrees, there is
        no static echo, an element receives it with less than 10 dB of SNR, or counts differ; if no
        range is given and the array measures the strongest echo in another direction.

    Notes
    -----
    See `processing.calibration.element_errors` for ambiguities. The residual is the error after
    correction at the angles used; for one angle in one frame it is the noise only, since there
    are no redundant values. It is not the error at other angles: channels that depend on the
    angle, by patterns and coupling, are visible only with several angles.
    """
    _check_several_elements_and_equal_ramps(radar)
    recordings = _pair_recordings_with_positions(cubes, azimuth_rad, elevation_rad, range_m)
    uncalibrated = replace(radar, calibration=None)
    reflectors, indices = [], []
    for index, placed in enumerate(recordings):
        for frame_index, frame in enumerate(_iter_frames(placed.frames)):
            reflectors.append(
                measure_static_reflector(frame, uncalibrated.for_frame(frame_index), placed.range_m)
            )
            indices.append(index)
        if index not in indices:
            raise InvalidSetting(
                _setting_name_of_recording("cubes", index, len(recordings)),
                value="no frame",
                expected="one frame or more, with the reflector",
                fix="pass the cube of a recording",
            )
    recording = np.array(indices)
    measured_m = np.bincount(
        recording, [measured.range_m for measured in reflectors]
    ) / np.bincount(recording)
    given_m = np.array(
        [np.nan if placed.range_m is None else placed.range_m for placed in recordings]
    )
    is_range_given = np.isfinite(given_m)
    ranges_m = np.where(is_range_given, given_m, measured_m)
    unit_vectors = np.array([placed.unit_vector for placed in recordings])
    paths_m = _two_way_paths_m(radar, ranges_m[:, None] * unit_vectors)
    if not is_range_given[0]:
        _check_strongest_echo_lies_in_direction(reflectors[0], unit_vectors[0], radar)
    snr = np.min(
        [abs(measured.snapshot) ** 2 / measured.noise_power for measured in reflectors], axis=0
    )
    _check_min_element_snr(snr, radar)
    errors = fit_element_errors(
        np.array([measured.snapshot for measured in reflectors]),
        np.array([measured.noise_power for measured in reflectors]),
        _ideal_near_field_snapshots(paths_m, ranges_m, unit_vectors, radar)[recording],
        unit_vectors[recording],
        _wavelength_m(radar),
    )
    offsets_m = (measured_m - paths_m.mean(axis=1) / 2)[is_range_given]
    return CalibrationResult(
        calibration=_build_calibration(errors, radar, offsets_m),
        snr=tuple(snr.tolist()),
        gain_std=tuple(errors.channel_std.tolist()),
        position_std_m=tuple(map(tuple, errors.position_std_m.tolist())),
        range_m=tuple(measured_m.tolist()),
        findings=calibration_findings(
            reflectors,
            recording,
            is_range_given,
            unit_vectors,
            errors,
            snr,
            radar,
            _wavelength_m(radar),
        ),
    )


class _PlacedRecording(NamedTuple):
    """A recording and the position of the reflector in it."""

    frames: Frames
    unit_vector: np.ndarray
    """Unit vector to the reflector, (3,)."""
    range_m: float | None


def _pair_recordings_with_positions(
    cubes: Frames | Sequence[Frames], azimuth_rad: Any, elevation_rad: Any, range_m: Any
) -> list[_PlacedRecording]:
    """Pair each recording with the angles and the range of its reflector."""
    angles = as_tuple_or_none(azimuth_rad)
    recordings: list[Any] = [cubes] if angles is None else list(cubes)
    azimuths = (azimuth_rad,) if angles is None else angles
    if len(recordings) != len(azimuths) or not recordings:
        raise InvalidSetting(
            "azimuth_rad",
            value=f"{len(azimuths)} angles for {len(recordings)} recordings",
            expected="one angle for each recording",
            fix="give them in the same order",
        )
    n = len(recordings)
    bounds = {"at_least": -np.pi / 2, "at_most": np.pi / 2}
    elevations = _values_per_recording("elevation_rad", elevation_rad, n)
    ranges = _values_per_recording("range_m", range_m, n)
    return [
        _PlacedRecording(
            recordings[index],
            _unit_vector(
                check_number(
                    _setting_name_of_recording("azimuth_rad", index, n), azimuths[index], **bounds
                ),
                check_number(
                    _setting_name_of_recording("elevation_rad", index, n),
                    elevations[index],
                    **bounds,
                ),
            ),
            None
            if ranges[index] is None
            else check_number(
                _setting_name_of_recording("range_m", index, n), ranges[index], above=0.0
            ),
        )
        for index in range(n)
    ]


def _check_strongest_echo_lies_in_direction(
    measured: MeasuredReflector, unit_vector: np.ndarray, radar: Radar
) -> None:
    """Raise `InvalidSetting` if the array measures the strongest echo far from the reflector."""
    mismatch = describe_direction_mismatch(measured, unit_vector, radar, _wavelength_m(radar))
    if mismatch is None:
        return
    others = [f"{range_m:.4g} m" for range_m in measured.other_ranges_m]
    raise InvalidSetting(
        "range_m",
        value=f"missing, and the strongest static echo, at {measured.range_m:.4g} m, is not in the"
        f" direction of the reflector: {mismatch}",
        expected="the range of the reflector where another echo is the strongest, such as a wall",
        fix=f"give the range, of this echo, {measured.range_m:.4g} m,"
        + (f" or of the next strongest, {', '.join(others)}," if others else "")
        + " and check the sign of the angle and the order of the antennas",
    )


def _setting_name_of_recording(name: str, index: int, n_recordings: int) -> str:
    return name if n_recordings == 1 else f"{name}.{index}"


def _values_per_recording(setting: str, values: Any, n_recordings: int) -> tuple[Any, ...]:
    members = as_tuple_or_none(values)
    if members is None:
        return (values,) * n_recordings
    if len(members) != n_recordings:
        raise InvalidSetting(
            setting,
            value=f"{len(members)} numbers for {n_recordings} recording{'s' * (n_recordings != 1)}",
            expected="one for all recordings, or one for each",
            fix="give them in the order of the recordings",
        )
    return members


def _iter_frames(frames: Frames) -> Iterator[xr.DataArray]:
    if isinstance(frames, xr.DataArray) and "frame" in frames.dims:
        for index in range(frames.sizes["frame"]):
            yield frames.isel(frame=slice(index, index + 1))
        return
    for frame in frames if isinstance(frames, Iterable) else [frames]:
        if not (isinstance(frame, xr.DataArray) and "frame" in frame.dims):
            axes = f" over {frame.dims}" if isinstance(frame, xr.DataArray) else ""
            raise InvalidSetting(
                "cubes",
                value=f"a {type(frame).__name__}{axes}",
                expected="a DataArray (frame, chirp, rx, sample), or its frames one by one",
                fix="pass the cube of a recording; a list of cubes needs a list of azimuths",
            )
        yield frame


def _wavelength_m(radar: Radar) -> float:
    return SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz


def _unit_vector(azimuth: float, elevation: float) -> np.ndarray:
    cos_elevation = np.cos(elevation)
    return np.array(
        [cos_elevation * np.cos(azimuth), cos_elevation * np.sin(azimuth), np.sin(elevation)]
    )


def _two_way_paths_m(radar: Radar, positions_m: np.ndarray) -> np.ndarray:
    """Return paths from transmitters over positions to receivers, (n_positions, n_elements)."""
    outbound_m = np.linalg.norm(positions_m[:, None] - np.array(radar.array.tx_m), axis=-1)
    return_m = np.linalg.norm(positions_m[:, None] - np.array(radar.array.rx_m), axis=-1)
    return np.asarray((outbound_m[:, :, None] + return_m[:, None]).reshape(len(positions_m), -1))


def _ideal_near_field_snapshots(
    paths_m: np.ndarray, ranges_m: np.ndarray, unit_vectors: np.ndarray, radar: Radar
) -> np.ndarray:
    """Return near-range snapshots of equal channels, (n_positions, n_elements)."""
    errors_m = radar.element_positions_m - radar.array.virtual_positions_m
    excess_m = paths_m - 2 * ranges_m[:, None] - unit_vectors @ errors_m.T
    return np.exp(2j * np.pi / _wavelength_m(radar) * excess_m)


def _build_calibration(
    errors: ElementErrors, radar: Radar, range_offsets_m: np.ndarray
) -> Calibration:
    gain = 1 / errors.channel
    gain *= np.exp(-1j * np.angle(gain.sum())) / abs(gain).mean()
    previous, n_rx = radar.calibration, radar.array.n_rx
    position_error_m = (
        radar.element_positions_m - radar.array.virtual_positions_m + errors.position_m
    )
    has_position_errors = position_error_m.any() or (
        previous is not None and previous.position_error_m is not None
    )
    offset_m = 0.0 if previous is None else previous.range_offset_m
    return Calibration(
        elements=tuple((index // n_rx, index % n_rx) for index in range(radar.n_channels)),
        gain=tuple((float(factor.real), float(factor.imag)) for factor in gain),
        position_error_m=tuple(map(tuple, position_error_m.tolist()))
        if has_position_errors
        else None,
        range_offset_m=float(range_offsets_m.mean()) if range_offsets_m.size else offset_m,
        residual=errors.residual,
    )


def _check_several_elements_and_equal_ramps(radar: Radar) -> None:
    if radar.n_channels < 2:
        raise InvalidSetting(
            "radar.array",
            value="an array of one transmitter and one receiver",
            expected="several elements, which are compared with each other",
            fix="calibrate an array of several elements",
        )
    if radar.frame.modulation is not None:
        raise InvalidSetting(
            "radar.frame.modulation",
            value=radar.frame.modulation.kind(),
            expected="none, since calibration needs equal ramps",
            fix="record the reflector with equal ramps; gains and positions hold for other"
            " ramps, too",
        )


def _check_min_element_snr(element_snr: np.ndarray, radar: Radar) -> None:
    if element_snr.min() >= _MIN_SNR:
        return
    weak_elements = [
        element_tx_rx_label(index, radar)
        for index in np.flatnonzero(element_snr < _MIN_SNR).tolist()
    ]
    raise InvalidSetting(
        "cube",
        value=f"a reflector {float(to_decibels(max(element_snr.min(), 1e-30))):.1f} dB over the"
        f" noise in element {weak_elements[0]}"
        + (f" and {len(weak_elements) - 1} other weak elements" if weak_elements[1:] else ""),
        expected="at least 10 dB in each element, since a gain would amplify noise",
        fix="record a larger or nearer reflector, or for longer; remove a dead antenna from the"
        " array",
    )
