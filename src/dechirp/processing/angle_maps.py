"""Range-azimuth map of a frame, and angle spectrum of one detection."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.conventions import axis_coordinate, labelled_array, labelled_variable
from dechirp.core.detection_columns import detection_columns_as_floats
from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import run_in_threads, split_range, thread_count
from dechirp.core.units import power_units
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.base import SpectralEstimator
from dechirp.processing.chain import Chain
from dechirp.processing.direction_finding import (
    checked_direction_aperture,
    element_snapshots_and_noise,
    phase_centres_m,
    range_from_phase_centre_m,
)
from dechirp.processing.range_walk import (
    sample_to_repetition_ratio,
    select_frame_transform,
    slow_time_frequency_growth_per_sample,
)
from dechirp.processing.refine import Tones, refine_tones
from dechirp.processing.scaling import to_single_precision
from dechirp.processing.simd_beamforming import mirrored_beam_weights, raise_to_largest_beam_power
from dechirp.processing.spectrum import (
    FrameTransform,
    Transform,
    check_samples_were_finite,
    range_doppler_real_and_imaginary,
)
from dechirp.processing.velocity_ambiguity import by_ramps
from dechirp.processing.virtual_array import slot_phase_factors, split_chirps_into_slots
from dechirp.radar.cube import select_only_frame
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# Points of an angle spectrum over one angle, for each of the grid that peaks are searched on.
_SPECTRUM_OVERSAMPLING = 4
_REQUIRED_COLUMNS = ("range", "velocity", "azimuth", "elevation", "snr", "ambiguity_number")
# Strongest other detections of a frame whose sidelobes are subtracted.
_MAX_SUBTRACTED_TONES = 32


@check_argument_types
def range_azimuth_map(cube: xr.DataArray, radar: Radar, chain: Chain | None = None) -> xr.DataArray:
    """Compute the power over azimuth and range of one frame, (chirp, rx, sample).

    The maximum over all velocities, and over elevations if the array resolves them, of beams in
    each cell of the range-Doppler map without padding. The noise floor is the maximum of noise,
    some 8 dB over its mean.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample)
        Complex or real samples of one frame, any order of axes; it may have an axis `frame` of
        length 1.
    radar : Radar
        The radar that it was taken with, with its calibration.
    chain : Chain, optional
        Its windows and its field of view.

    Returns
    -------
    DataArray (azimuth, range), W
        `azimuth` (rad) left positive, in equal steps of its sine; `range` (m) including
        range-Doppler coupling; both from the middle of the array. A target on a bin has
        the power of its echo in one element. Of uncalibrated samples, in full scale squared.

    Raises
    ------
    InvalidSetting
        If the cube has several frames or samples that are not finite, the radar cannot have taken
        the frame, or the array does not resolve azimuth.

    Notes
    -----
    Transmitters are decoded, and the motion between them compensated, for the velocity of each
    cell. Velocities are those about zero: under time-division multiplexing an aliased target
    appears at a wrong azimuth. `detect` resolves the velocity ambiguity.
    """
    chain = chain or Chain()
    samples, radar = _rising_ramp_channels_and_radar(cube, radar)
    plan = _plan_range_azimuth_transforms(radar, chain)
    spectrum = range_doppler_real_and_imaginary(
        samples,
        radar.frame.chirp.sampling,
        plan.range_transform,
        plan.doppler_transform,
        plan.transform,
    )
    check_samples_were_finite(spectrum[0, ..., 0])
    n_threads = thread_count()
    parts = split_range(len(spectrum), n_threads)
    powers = np.zeros((len(parts), *plan.coordinates.sizes.values()), np.float32)

    def add_part(part: int) -> None:
        aligned = _align_and_combine_slots(spectrum[parts[part]], plan.beat_rad, radar)
        raise_to_largest_beam_power(
            powers[part], aligned, plan.compensation[parts[part]], plan.folding, plan.weights
        )

    run_in_threads(n_threads, add_part, range(len(parts)))
    attributes = {"long_name": "power", "units": _power_unit(cube)}
    variable = labelled_variable(("azimuth", "range"), powers.max(axis=0), attributes)
    return labelled_array(variable, plan.coordinates)


class _MapPlan(NamedTuple):
    """Precomputed transforms and weights for the maps of one radar."""

    range_transform: Transform
    doppler_transform: Transform
    transform: FrameTransform
    beat_rad: np.ndarray
    """Beat frequency of each range row, rad per sample."""
    compensation: np.ndarray
    folding: np.ndarray
    weights: np.ndarray
    """This and the two above: see `raise_to_largest_beam_power`."""
    coordinates: xr.Coordinates
    """Azimuth and range."""


@lru_cache(maxsize=8)  # 0.7 ms of 5
def _plan_range_azimuth_transforms(radar: Radar, chain: Chain) -> _MapPlan:
    aperture = checked_direction_aperture(radar, chain.field_of_view)
    if not aperture.resolves_azimuth_and_elevation[0]:
        raise InvalidSetting(
            "radar.array",
            value="a vertical linear array",
            expected="elements at several positions along y, which resolve azimuth",
            fix="compute elevations with `angle_spectrum`",
        )
    frame, chirp = radar.frame, radar.frame.chirp
    over_range, over_velocity = (
        Transform(window=window, n_points=n, n_bins=n)
        for window, n in (
            (chain.range_window, chirp.n_samples),
            (chain.doppler_window, frame.n_chirps),
        )
    )
    range_m = chirp.range_bins_m()
    n_velocities = frame.n_chirps
    doppler_hz = (np.arange(n_velocities) - n_velocities // 2) / (n_velocities * frame.repetition_s)
    pair_sums, weights = mirrored_beam_weights(aperture)
    compensation, decoding = _motion_phases_and_decoding_matrix(doppler_hz, radar)
    azimuth_rad = aperture.direction_grid.azimuth_rad
    return _MapPlan(
        range_transform=over_range,
        doppler_transform=over_velocity,
        transform=select_frame_transform(chain.range_walk, chirp),
        beat_rad=2 * np.pi / over_range.n_bins * np.arange(range_m.size),
        compensation=compensation,
        folding=(decoding @ pair_sums).astype(np.complex64),
        weights=weights,
        coordinates=xr.Coordinates(
            {
                "azimuth": axis_coordinate("azimuth", azimuth_rad),
                "range": axis_coordinate("range", range_m),
            }
        ),
    )


@check_argument_types
def angle_spectrum(
    cube: xr.DataArray, radar: Radar, detections: xr.Dataset, index: int, chain: Chain | None = None
) -> xr.DataArray:
    """Compute the spectrum over directions of one detection.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample)
        The frame of the detection; it may have an axis `frame` of length 1.
    radar : Radar
        The radar as it is in that frame, see `Radar.for_frame`.
    detections : Dataset over `detection`
        The detections of the frame, from `detect`.
    index : int
        Index of the detection.
    chain : Chain, optional
        Its spectral estimator; Bartlett beams if it has none.

    Returns
    -------
    DataArray (elevation, azimuth)
        In rad from the middle of the array, whereas detections refer to the origin; in equal
        steps of their sines; one value along an angle that the array does not resolve. The
        attribute `estimator` names the estimator. Beams are powers in one element, in W; spectra
        of other estimators have their own scales.

    Raises
    ------
    InvalidSetting
        If the cube has several frames, the radar cannot have taken the frame, the array resolves
        no direction, or `detections` have no row `index`.
    """
    chain = chain or Chain()
    samples, radar = _rising_ramp_channels_and_radar(cube, radar)
    aperture = checked_direction_aperture(radar, chain.field_of_view)
    detection_columns_as_floats(detections, _REQUIRED_COLUMNS)  # raises if one is missing
    check_integer("index", index, at_least=0, at_most=detections.sizes.get("detection", 0) - 1)
    tones, doppler_hz, noise = _refine_tone_with_doppler_and_noise(
        samples, radar, detections, index
    )
    check_samples_were_finite(tones.amplitude)
    amplitude = by_ramps.remove_beat_phase(tones.amplitude, tones.fast, radar.frame)
    snapshots, noise = element_snapshots_and_noise(amplitude, doppler_hz, noise, radar)
    estimator = chain.angle if isinstance(chain.angle, SpectralEstimator) else Bartlett()
    azimuth, elevation = aperture.direction_grid.azimuth_rad, aperture.direction_grid.elevation_rad
    if not all(aperture.resolves_azimuth_and_elevation):
        azimuth, elevation = _oversample_angles(azimuth), _oversample_angles(elevation)
    steering = aperture.steering_vectors(azimuth, elevation[:, None]).reshape(
        -1, aperture.n_elements
    )
    spectrum = estimator.spectrum_at(
        estimator.precompute_for_spectrum(snapshots, aperture, noise), steering
    )
    return xr.DataArray(
        spectrum.reshape(len(elevation), len(azimuth)),
        dims=("elevation", "azimuth"),
        coords={
            "elevation": axis_coordinate("elevation", elevation),
            "azimuth": axis_coordinate("azimuth", azimuth),
        },
        attrs={
            "units": _power_unit(cube),
            "long_name": "spectrum over directions",
            "estimator": type(estimator).kind(),
        },
    )


def _has_several_slots_of_one_transmitter(frame: Frame) -> bool:
    """Return whether all slots are of one transmitter, so that each cell combines them."""
    return frame.multiplexing is None and frame.n_slots > 1


def _motion_phases_and_decoding_matrix(
    doppler_hz: np.ndarray, radar: Radar
) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion compensation of slots, and the decoding matrix.

    (velocity, channel) complex64, and (channel, element), from channels or from the elements of
    `_combine_single_transmitter_slots`.
    """
    n_rx, n_slots = radar.array.n_rx, radar.frame.n_slots
    if _has_several_slots_of_one_transmitter(radar.frame):
        return np.ones((len(doppler_hz), n_rx), np.complex64), np.eye(n_rx)
    compensation = np.repeat(slot_phase_factors(radar.frame, doppler_hz).conj(), n_rx, axis=1)
    zeros = np.zeros(n_slots * n_rx)
    decoding, _ = element_snapshots_and_noise(np.eye(n_slots * n_rx), zeros, zeros, radar)
    return compensation.astype(np.complex64), decoding[:, 0]


def _align_and_combine_slots(
    spectrum: np.ndarray, beat_rad: np.ndarray, radar: Radar
) -> np.ndarray:
    """Align slots of different ramps, combine those of one transmitter; split the parts."""
    frame = radar.frame
    if frame.has_identical_ramps and not _has_several_slots_of_one_transmitter(frame):
        return spectrum
    channels = spectrum[:, :, 0] + 1j * spectrum[:, :, 1]
    if not frame.has_identical_ramps:
        ones = np.ones((len(beat_rad), channels.shape[1]), np.complex64)
        channels *= by_ramps.remove_beat_phase(ones, beat_rad, frame).T
    if _has_several_slots_of_one_transmitter(frame):
        channels = _combine_single_transmitter_slots(channels, radar)
    return np.stack([channels.real, channels.imag], axis=2)


def _combine_single_transmitter_slots(spectrum: np.ndarray, radar: Radar) -> np.ndarray:
    """Combine the slots of one transmitter, (velocity, element, range) complex64."""
    n_velocities, _, n_rows = spectrum.shape
    elements = np.empty((n_velocities, radar.array.n_rx, n_rows), np.complex64)
    zeros = np.zeros(n_rows)
    for row, cells in zip(elements, spectrum, strict=True):
        row[:] = element_snapshots_and_noise(cells.T, zeros, zeros, radar)[0][:, 0].T
    return elements


def _rising_ramp_channels_and_radar(cube: xr.DataArray, radar: Radar) -> tuple[np.ndarray, Radar]:
    """Return the channels of rising ramps, (chirp, channel, sample), and their radar."""
    frame = select_only_frame(cube, radar)
    samples = to_single_precision(
        frame.variable.transpose("chirp", "rx", "sample").values,
        is_complex=radar.frame.chirp.sampling == "complex",
    )
    samples = split_chirps_into_slots(samples, radar.frame)
    if not radar.frame.has_falling_ramps:
        return samples, radar
    return np.ascontiguousarray(samples[:, : radar.array.n_rx]), radar.with_rising_ramps_only()


def _refine_tone_with_doppler_and_noise(
    samples: np.ndarray, radar: Radar, detections: xr.Dataset, index: int
) -> tuple[Tones, np.ndarray, np.ndarray]:
    """Refine the tone of a detection; return it with its Doppler frequency and amplitude noise.

    The sidelobes of other detections are subtracted, as in `detect`.
    """
    frame, chirp = radar.frame, radar.frame.chirp
    offset_m = 0.0 if radar.calibration is None else radar.calibration.range_offset_m
    angles = detections.azimuth.values, detections.elevation.values
    centre_m = phase_centres_m(*angles, detections.ambiguity_number.values, radar)
    range_m = range_from_phase_centre_m(centre_m, detections.range.values, *angles) + offset_m
    # Sources of one detection share its range and velocity but for rounding; their SNRs add up.
    positions = np.stack([range_m.round(9), np.nan_to_num(detections.velocity.values)])
    tone_positions, tone_of_row = np.unique(positions, axis=1, return_inverse=True)
    snr = np.bincount(tone_of_row, detections.snr.values)
    tone_index = tone_of_row[index]
    order = np.argsort(-snr, kind="stable")
    order = np.union1d(order[:_MAX_SUBTRACTED_TONES], tone_index)
    order = order[np.argsort(-snr[order], kind="stable")]
    beat_hz, doppler_hz = chirp.echo_frequencies_hz(*tone_positions[:, order])
    tones = refine_tones(
        samples,
        2 * np.pi * frame.repetition_s * doppler_hz,
        2 * np.pi / chirp.sample_rate_hz * beat_hz,
        # The noise follows from the energy, which is estimated here. With zero, all sidelobes are
        # subtracted, and changes of amplitudes by noise too: 0.12 standard deviations at 3 bins.
        np.zeros(len(order)),
        growth=slow_time_frequency_growth_per_sample(chirp),
        interval_ratio=sample_to_repetition_ratio(frame),
    )
    refined_index = np.flatnonzero(order == tone_index)
    tone = Tones(
        tones.slow[refined_index],
        tones.fast[refined_index],
        tones.energy[refined_index],
        tones.amplitude[refined_index],
    )
    n_samples = frame.n_chirps * chirp.n_samples
    sample_noise = tone.energy / (snr[tone_index] + samples.shape[1])
    return tone, doppler_hz[refined_index], sample_noise / n_samples


def _oversample_angles(angle_rad: np.ndarray) -> np.ndarray:
    """Add angles between given ones, in equal steps of their sines."""
    n = _SPECTRUM_OVERSAMPLING * (len(angle_rad) - 1) + 1
    return np.arcsin(np.linspace(np.sin(angle_rad[0]), np.sin(angle_rad[-1]), n))


def _power_unit(cube: xr.DataArray) -> str:
    return power_units(cube.attrs.get("units"))
