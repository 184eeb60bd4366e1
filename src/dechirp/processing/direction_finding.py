"""Directions of the sources of detections, from their amplitudes in the channels."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.detection_columns import zero_where_unknown
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.angle.aperture import Aperture, FieldOfView, radar_aperture
from dechirp.processing.angle.base import DirectionEstimator, Directions
from dechirp.processing.channel_errors import ChannelErrors, estimate_channel_errors
from dechirp.processing.refine import SidelobeErrors
from dechirp.processing.virtual_array import (
    can_separate_transmitters,
    element_amplitudes,
    element_to_channel_noise_ratio,
)
from dechirp.radar.array import Array
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.theory.direction_bounds import unit_vector_derivatives, unit_vectors

# Largest standard error of an angle: two of them to each side are half of the front.
_MAX_STD_RAD = float(np.radians(22.5))
# Share of the largest sine from which the maximum is at the limit of the search.
_LIMIT_SHARE = 1 - 1e-3
# 10 dB: the phase of an element then changes by 0.3 rad at most.
_MIN_SIGNAL_TO_SIDELOBES = 10.0


class Sources(NamedTuple):
    """Sources of all detections, strongest first within each; arrays (n_sources,).

    Angles are NaN where none was estimated: a detection has at least one source.
    """

    detection: np.ndarray
    """Index of its detection, ascending."""
    power_share: np.ndarray
    """Share of the power of its detection."""
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    azimuth_std_rad: np.ndarray
    elevation_std_rad: np.ndarray
    channel_phase_rms_rad: np.ndarray
    """RMS error of the phases of its detection, see `channel_errors.ChannelErrors`."""
    has_unknown_angle: np.ndarray
    """Whether an angle was estimated but is left unknown, see `_leave_out_unusable_angles`."""


def checked_direction_aperture(radar: Radar, field_of_view: FieldOfView) -> Aperture:
    """Return the aperture of the virtual array, if it resolves directions.

    Raises
    ------
    InvalidSetting
        About `chain.angle`, if all elements have one position across the line of sight, or the code
        does not separate the transmitters or has them in unknown order.

    Notes
    -----
    A frame of one round measures no velocity, so its directions are those of targets at rest, see
    `assumes_targets_at_rest`.
    """
    problem = None
    try:
        virtual_aperture = radar_aperture(radar, field_of_view)
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        if mistake.setting != "Radar.array":
            raise
        problem, expected = mistake.value, mistake.expected
    if not can_separate_transmitters(radar.frame):
        n_tx = len(radar.array.tx_m)
        problem, expected = f"a code of {n_tx} transmitters", "a code that parts them over a round"
    if not getattr(radar.frame.multiplexing, "is_order_known", True):
        problem, expected = "transmitters in unknown order", "the transmitter of each sub-band"
    if problem is not None:
        raise InvalidSetting(
            "chain.angle",
            value=problem,
            expected=expected,
            fix="set angle to null, or correct the radar",
        )
    return virtual_aperture


def assumes_targets_at_rest(frame: Frame) -> bool:
    """Return whether directions assume targets at rest: slots of a single round differ in time."""
    return frame.multiplexing is not None and frame.n_chirps == 1 < frame.n_slots


def can_resolve_directions(radar: Radar) -> bool:
    """Return whether the array of a radar resolves directions."""
    try:
        checked_direction_aperture(radar, FieldOfView())
    except InvalidSetting:
        return False
    return True


def sources_without_directions(n_detections: int) -> Sources:
    """Return one source without direction for each of n detections."""
    unknown = np.full(n_detections, np.nan)
    return Sources(
        detection=np.arange(n_detections),
        power_share=np.ones(n_detections),
        azimuth_rad=unknown,
        elevation_rad=unknown,
        azimuth_std_rad=unknown,
        elevation_std_rad=unknown,
        channel_phase_rms_rad=unknown,
        has_unknown_angle=np.zeros(n_detections, bool),
    )


def phase_centres_m(
    azimuth_rad: np.ndarray, elevation_rad: np.ndarray, ambiguity_number: np.ndarray, radar: Radar
) -> np.ndarray:
    """Return the phase centre that ranges are measured from, (n, 3).

    The middle of the array: half of the mean sum of a transmitter's and a receiver's position. For
    directions, see `directions_from_phase_centre`. An unknown angle counts as 0, as in the steering
    of a linear array, and so does the middle along its axis. Without any angle, or with the
    ambiguity number that it depends on unknown, the offset to the origin is unknown: 0.
    """
    centre_m = radar.element_positions_m.mean(axis=0) / 2
    has_angle = np.stack([np.isfinite(azimuth_rad), np.isfinite(elevation_rad)], axis=-1)
    is_known = has_angle.any(axis=1) & known_direction_mask(ambiguity_number, radar.frame)
    axes = np.column_stack([np.ones(len(has_angle), bool), has_angle]) & is_known[:, None]
    return np.where(axes, centre_m, 0.0)


def directions_from_phase_centre(
    range_m: np.ndarray,
    azimuth_rad: np.ndarray,
    elevation_rad: np.ndarray,
    ambiguity_number: np.ndarray,
    radar: Radar,
) -> tuple[np.ndarray, np.ndarray]:
    r"""Convert fitted directions of plane waves to directions from phase centres, (n,) each.

    The path from a transmitter at t over a target at R u to a receiver at r, both relative to the
    phase centre, is

    .. math::

        2R - \mathbf{u} \cdot (\mathbf{t} + \mathbf{r}) + \frac{q}{2R} + O(R^{-2}), \quad
        q = |\mathbf{t}|^2 - (\mathbf{u} \cdot \mathbf{t})^2
            + |\mathbf{r}|^2 - (\mathbf{u} \cdot \mathbf{r})^2.

    A plane wave has the first two terms. Its least-squares fit to the elements s = t + r attributes
    part of the third to the direction. With the derivatives D of u by the angles, it moves them by

    .. math::

        \delta = -\frac{1}{2R} (D C D^\mathsf{T})^{-1} D\, \langle \mathbf{s}\, q \rangle, \quad
        C = \langle \mathbf{s}\, \mathbf{s}^\mathsf{T} \rangle,

    which this function subtracts. A linear array of one transmitter and receivers in equal steps
    therefore finds directions from the middle of its receivers; one of several transmitters from
    the mean of both middles, each weighted by the variance of its positions.

    The fit takes the frequency f at mid-window, but the echo from a delay tau has f - S tau there,
    with S tau up to the sample rate: 1.3e-4 of 77 GHz at 10 MHz. Its direction is therefore that of
    u f / (f - S tau), moved by (D C D^T)^-1 D C u S tau / (f - S tau). Amplitudes of triangles are
    the mean of both ramps: f is that of rising ramps, and the mean of both echoes takes the place
    of f - S tau. Rows without a known direction, or at a range within the array, stay as they are.
    """
    angles = np.stack([azimuth_rad, elevation_rad], axis=1)
    resolved = np.flatnonzero(np.isfinite(angles).any(axis=0))
    moments = _array_moments(radar.array, radar.element_positions_m.tobytes())
    is_row = known_direction_mask(ambiguity_number, radar.frame) & (range_m > moments.size_m)
    if not resolved.size or not is_row.any():
        return azimuth_rad, elevation_rad
    known = zero_where_unknown(angles)
    unit = unit_vectors(known[:, 0], known[:, 1])
    slopes = unit_vector_derivatives(known[:, 0], known[:, 1])[:, resolved]
    squares = (unit[:, :, None] * unit[:, None, :]).reshape(-1, 9)
    moment = moments.third[[0, 4, 8]].sum(axis=0) - squares @ moments.third
    curvature = slopes @ moments.covariance @ slopes.swapaxes(1, 2)
    inverse = 1 / curvature if resolved.size == 1 else np.linalg.pinv(curvature, hermitian=True)
    fitted_hz = radar.frame.chirp.mean_sampled_frequency_hz
    frequency_excess = fitted_hz / _mean_echo_frequency_hz(range_m, radar.frame) - 1
    per_range = 0.5 / np.where(is_row, range_m, 1)
    moment = per_range[:, None] * moment + frequency_excess[:, None] * (unit @ moments.covariance)
    shift = (inverse @ (slopes @ moment[:, :, None]))[:, :, 0]
    angles[:, resolved] += np.where(is_row[:, None], shift, 0)
    return angles[:, 0], angles[:, 1]


def _mean_echo_frequency_hz(range_m: np.ndarray, frame: Frame) -> np.ndarray:
    """Return the mean frequency over the ramps of echoes at mid-window, (n,)."""
    chirp = frame.chirp
    start_hz = chirp.start_frequency_hz + np.mean([ramp.shift_hz for ramp in frame.ramps])
    swept_hz = chirp.slope_hz_per_s * chirp.mid_window_s - range_m / chirp.range_m(1.0)
    return np.asarray(start_hz + np.mean([ramp.sign for ramp in frame.ramps]) * swept_hz)


def _wavefront_curvature_rad(
    range_m: np.ndarray, azimuth_rad: np.ndarray, elevation_rad: np.ndarray, radar: Radar
) -> np.ndarray:
    """Return the phase of the term q / 2R of paths, see `directions_from_phase_centre`.

    (n, n_elements), 0 at ranges within the array.
    """
    moments = _array_moments(radar.array, radar.element_positions_m.tobytes())
    wavelength_m = SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz
    per_m2 = np.pi / wavelength_m / np.maximum(range_m, moments.size_m)
    unit = _unit_vectors_with_nan_as_zero(azimuth_rad, elevation_rad)
    along_m = moments.antennas_m @ unit.T
    squares_m2 = np.sum(np.sum(moments.antennas_m**2, axis=2)[:, :, None] - along_m**2, axis=0)
    return np.asarray((np.where(range_m > moments.size_m, per_m2, 0) * squares_m2).T)


class _ArrayMoments(NamedTuple):
    """Moments of antennas t and r and elements s = t + r, relative to the phase centre."""

    antennas_m: np.ndarray
    """Positions t and r of each element, (2, n_elements, 3)."""
    third: np.ndarray
    """Mean of (t t^T + r r^T) s, (9, 3): pairs of coordinates by coordinates of s."""
    covariance: np.ndarray
    """Mean of s s^T, (3, 3)."""
    size_m: float
    """Largest distance of an antenna from the phase centre."""


@lru_cache(maxsize=8)
def _array_moments(array: Array, element_position_bytes: bytes) -> _ArrayMoments:
    elements_m = np.frombuffer(element_position_bytes).reshape(-1, 3)
    middle_m = elements_m.mean(axis=0) / 2
    tx_m, rx_m = np.array(array.tx_m) - middle_m, np.array(array.rx_m) - middle_m
    antennas_m = np.stack([np.repeat(tx_m, len(rx_m), axis=0), np.tile(rx_m, (len(tx_m), 1))])
    elements_m = elements_m - 2 * middle_m
    return _ArrayMoments(
        antennas_m,
        np.einsum("mka,mkb,kc->abc", antennas_m, antennas_m, elements_m).reshape(9, 3)
        / len(elements_m),
        elements_m.T @ elements_m / len(elements_m),
        float(np.linalg.norm(np.concatenate([tx_m, rx_m]), axis=1).max()),
    )


def range_and_direction_from_origin(
    range_m: np.ndarray, azimuth_rad: np.ndarray, elevation_rad: np.ndarray, centre_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Convert ranges and directions from phase centres, (n, 3), to the origin, (n,) each.

    Unknown angles remain unknown, see `phase_centres_m`. Ranges up to the distance of the origin
    are sidelobes and constant offsets, which have no position, and stay as they are.
    """
    x, y, z = (
        centre_m + range_m[:, None] * _unit_vectors_with_nan_as_zero(azimuth_rad, elevation_rad)
    ).T
    is_target = _mask_of_ranges_beyond_centre_offset(range_m, centre_m)
    return (
        np.where(is_target, np.sqrt(x**2 + y**2 + z**2), range_m),
        np.where(is_target & np.isfinite(azimuth_rad), np.arctan2(y, x), azimuth_rad),
        np.where(
            is_target & np.isfinite(elevation_rad), np.arctan2(z, np.hypot(x, y)), elevation_rad
        ),
    )


def range_from_phase_centre_m(
    centre_m: np.ndarray, range_m: np.ndarray, azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> np.ndarray:
    """Return ranges from phase centres: the inverse of `range_and_direction_from_origin`."""
    position_m = (
        range_m[:, None] * _unit_vectors_with_nan_as_zero(azimuth_rad, elevation_rad) - centre_m
    )
    is_target = _mask_of_ranges_beyond_centre_offset(range_m, centre_m)
    return np.where(is_target, np.linalg.norm(position_m, axis=1), range_m)


def _mask_of_ranges_beyond_centre_offset(range_m: np.ndarray, centre_m: np.ndarray) -> np.ndarray:
    away_m = np.linalg.norm(centre_m, axis=1)
    return np.asarray((away_m > 0) & (range_m > away_m))


def _unit_vectors_with_nan_as_zero(
    azimuth_rad: np.ndarray, elevation_rad: np.ndarray
) -> np.ndarray:
    return unit_vectors(zero_where_unknown(azimuth_rad), zero_where_unknown(elevation_rad))


def known_direction_mask(ambiguity_number: np.ndarray, frame: Frame) -> np.ndarray:
    """Return the mask of directions whose ambiguity number is known or not needed, (n,)."""
    is_needed = frame.multiplexing is not None and not assumes_targets_at_rest(frame)
    return np.asarray(~np.isnan(ambiguity_number) | (not is_needed))


def element_snapshots_and_noise(
    amplitudes: np.ndarray, doppler_hz: np.ndarray, noise_power: np.ndarray, radar: Radar
) -> tuple[np.ndarray, np.ndarray]:
    """Return amplitudes of the virtual elements, (n, 1, n_elements), and their noise, (n,).

    Amplitudes in the channels, see `estimate_sources`, with the motion compensated, decoded and
    calibrated. Slots of a single transmitter are brought in phase with each other: no ambiguity
    number changes the phases between its elements.
    """
    if radar.frame.multiplexing is None:
        snapshots = _average_slots_in_phase(amplitudes, radar.frame.n_slots)
    else:
        snapshots = element_amplitudes(amplitudes, radar.frame, doppler_hz)
    snapshots = snapshots * radar.element_corrections
    noise = (
        noise_power
        * element_to_channel_noise_ratio(radar.frame)
        * np.mean(np.abs(radar.element_corrections) ** 2)
    )
    return snapshots[:, None], np.asarray(noise)


def _average_slots_in_phase(amplitudes: np.ndarray, n_slots: int) -> np.ndarray:
    """Average the slots, (n, n_rx), with the phases that maximise their sum."""
    if n_slots == 1:
        return amplitudes
    turns = _slot_alignment_factors(amplitudes, n_slots)
    return np.asarray(np.einsum("nl,nlr->nr", turns, _split_slots(amplitudes, n_slots)))


def _slot_alignment_factors(amplitudes: np.ndarray, n_slots: int) -> np.ndarray:
    """Return the factors (n, n_slots) whose sum over the slots has the most power."""
    by_slot = _split_slots(amplitudes, n_slots)
    alike = by_slot @ by_slot.conj().swapaxes(1, 2)
    return np.asarray(np.linalg.eigh(alike).eigenvectors[:, :, -1].conj() / np.sqrt(n_slots))


def _split_slots(amplitudes: np.ndarray, n_slots: int) -> np.ndarray:
    return amplitudes.reshape(len(amplitudes), n_slots, -1)


def _element_sidelobes(
    components: np.ndarray, amplitudes: np.ndarray, doppler_hz: np.ndarray, radar: Radar
) -> np.ndarray:
    """Return components of the sidelobes (n, n_components, channel) in the virtual elements.

    They are decoded and compensated like the amplitudes (n, channel) that contain them.
    """
    n, n_components, n_channels = components.shape
    frame = radar.frame
    rows = np.repeat(np.arange(n), n_components)
    flat = components.reshape(n * n_components, n_channels)
    if frame.multiplexing is not None:
        elements = element_amplitudes(flat, frame, doppler_hz[rows])
    elif frame.n_slots == 1:
        elements = flat
    else:
        turns = _slot_alignment_factors(amplitudes, frame.n_slots)[rows]
        elements = np.einsum("nl,nlr->nr", turns, _split_slots(flat, frame.n_slots))
    return np.reshape(elements * radar.element_corrections, (n, n_components, elements.shape[1]))


def sidelobe_dominated_mask(amplitudes: np.ndarray, sidelobes: SidelobeErrors | None) -> np.ndarray:
    """Return which detections, (n,), contain more sidelobes than directions can be estimated from.

    Amplitudes (n, channel) with less than ten times the power of their sidelobes: a direction would
    be biased by up to a sixth of the beamwidth, and more than one source would appear.
    """
    if sidelobes is None:
        return np.zeros(len(amplitudes), bool)
    power = np.mean(np.abs(amplitudes) ** 2, axis=1)
    return np.asarray(power < _MIN_SIGNAL_TO_SIDELOBES * sidelobes.power)


def _standard_error_factors(
    directions: Directions, sidelobes: np.ndarray, noise_power: np.ndarray, aperture: Aperture
) -> tuple[np.ndarray, np.ndarray]:
    """Return factors of the standard errors of azimuth and elevation due to sidelobes, (n, source).

    The standard errors are those of white noise with the power of noise and sidelobes together. A
    perturbation v of the snapshot moves the direction of a lone source by Re(g^H v) / |amplitude|,
    g = F^-1 D, with D the derivatives of its steering vector without the part along itself and
    F = Re D^H D. White noise moves it in proportion to |g|^2, a component of the sidelobes to
    |g^H v|^2, up to the number of elements times more.
    """
    n_elements = sidelobes.shape[2]
    factors = np.ones((2, *directions.azimuth_rad.shape))
    rows = np.flatnonzero(np.any(sidelobes != 0, axis=(1, 2)))
    if not rows.size:
        return factors[0], factors[1]
    angles = [
        zero_where_unknown(angle[rows])
        for angle in (directions.azimuth_rad, directions.elevation_rad)
    ]
    steering = aperture.steering_vectors(*angles)[..., None, :]
    slopes = aperture.steering_derivatives(*angles)
    slopes = slopes - np.sum(slopes * steering.conj(), axis=-1, keepdims=True) * (
        steering / n_elements
    )
    curvature = np.real(slopes.conj() @ slopes.swapaxes(-1, -2))
    response = np.linalg.pinv(curvature, hermitian=True) @ slopes
    white = np.sum(np.abs(response) ** 2, axis=-1)
    moved = np.einsum("nsae,nje->nsaj", response.conj(), sidelobes[rows])
    sidelobe_power = np.sum(np.abs(sidelobes[rows]) ** 2, axis=1).mean(axis=1)
    noise = noise_power[rows, None, None]
    ratio = (noise * white + np.sum(np.abs(moved) ** 2, axis=-1)) / np.maximum(
        (noise + sidelobe_power[:, None, None]) * white, np.finfo(float).tiny
    )
    for place, angle in enumerate(np.flatnonzero(aperture.resolves_azimuth_and_elevation)):
        factors[angle, rows] = np.sqrt(ratio[..., place])
    return factors[0], factors[1]


def _residual_sidelobe_power(
    directions: Directions, sidelobes: np.ndarray, aperture: Aperture
) -> np.ndarray:
    """Return the power in an element that sidelobes leave in the residual of the strongest, (n,).

    Sidelobes (n, n_components, n_elements) of echoes from its own direction leave none: they change
    the fitted amplitude, and do not explain a residual.
    """
    azimuth, elevation = (
        zero_where_unknown(angle[:, 0])
        for angle in (directions.azimuth_rad, directions.elevation_rad)
    )
    fitted = np.concatenate(
        [
            aperture.steering_vectors(azimuth, elevation)[:, None],
            aperture.steering_derivatives(azimuth, elevation),
        ],
        axis=1,
    )
    basis = np.linalg.qr(fitted.swapaxes(1, 2))[0]
    rest = sidelobes - (sidelobes @ basis.conj()) @ basis.swapaxes(1, 2)
    n_residuals = max(aperture.n_elements - fitted.shape[1], 1)
    return np.asarray(np.sum(np.abs(rest) ** 2, axis=(1, 2)) / n_residuals)


def estimate_sources(
    amplitudes: np.ndarray,
    doppler_hz: np.ndarray,
    noise_power: np.ndarray,
    radar: Radar,
    estimator: DirectionEstimator,
    virtual_aperture: Aperture,
    *,
    sidelobes: SidelobeErrors | None = None,
    range_m: np.ndarray | None = None,
) -> Sources:
    """Estimate the directions of n detections.

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx), complex
        Of the channels, see `processing.virtual_array.split_chirps_into_slots`.
    doppler_hz : array (n,)
        Unambiguous as far as known, to compensate the motion between slots.
    noise_power : array (n,)
        E|w|^2 in one amplitude of a channel.
    radar, estimator, virtual_aperture
        The radar of the detections, the direction estimator and the virtual array that it uses.
    sidelobes : SidelobeErrors, optional
        Other echoes in the amplitudes. It widens the standard errors; detections that it dominates
        have no directions, see `sidelobe_dominated_mask`.
    range_m : array (n,), optional
        Their ranges. The curvature of waves from there is no error of the channels.

    Notes
    -----
    Phase errors of the channels widen the standard errors too, see `channel_errors`. Angles at the
    limit of the field of view or with errors of more than 22.5 degrees are NaN.
    """
    snapshots, noise = element_snapshots_and_noise(amplitudes, doppler_hz, noise_power, radar)
    if sidelobes is None:
        directions = estimator.find_directions(snapshots, virtual_aperture, noise)
        residual_noise = noise
    else:
        components = _element_sidelobes(sidelobes.components, amplitudes, doppler_hz, radar)
        sidelobe_power = np.sum(np.abs(components) ** 2, axis=1).mean(axis=1)
        element_noise = noise + sidelobe_power
        directions = estimator.find_directions(snapshots, virtual_aperture, element_noise)
        factors = _standard_error_factors(directions, components, noise, virtual_aperture)
        residual_noise = noise + _residual_sidelobe_power(directions, components, virtual_aperture)
        is_masked = sidelobe_dominated_mask(amplitudes, sidelobes)
        for angle, std, factor in (
            (directions.azimuth_rad, directions.azimuth_std_rad, factors[0]),
            (directions.elevation_rad, directions.elevation_std_rad, factors[1]),
        ):
            std[:] = np.where(is_masked[:, None], np.nan, std * factor)
            angle[is_masked] = np.nan
    strongest = directions.azimuth_rad[:, 0], directions.elevation_rad[:, 0]
    channel_errors = estimate_channel_errors(
        snapshots[:, 0],
        directions,
        residual_noise,
        virtual_aperture,
        None if range_m is None else lambda: _wavefront_curvature_rad(range_m, *strongest, radar),
    )
    _widen_standard_errors(directions, channel_errors, virtual_aperture)
    has_unknown_angle = _leave_out_unusable_angles(directions, virtual_aperture)
    is_source = np.isfinite(directions.azimuth_rad) | np.isfinite(directions.elevation_rad)
    is_source[:, 0] = True
    detection, source = np.nonzero(is_source)
    power = np.where(np.isfinite(directions.power), directions.power, 0.0)
    total = power.sum(axis=1, keepdims=True)
    power_share = np.where(total > 0, power / np.where(total > 0, total, 1.0), 1.0)
    return Sources(
        detection,
        power_share[detection, source],
        directions.azimuth_rad[detection, source],
        directions.elevation_rad[detection, source],
        directions.azimuth_std_rad[detection, source],
        directions.elevation_std_rad[detection, source],
        channel_errors.phase_rms_rad[detection],
        has_unknown_angle[detection, source],
    )


def _widen_standard_errors(
    directions: Directions, channel_errors: ChannelErrors, aperture: Aperture
) -> None:
    """Add the errors of the channels to the standard errors, in place.

    They stay at most that of a uniform distribution over the field of view.
    """
    if not channel_errors.direction_variance_rad2.any():
        return
    limits = np.array([aperture.field_of_view.azimuth_rad, aperture.field_of_view.elevation_rad])
    is_resolved = aperture.resolves_azimuth_and_elevation
    stds = directions.azimuth_std_rad, directions.elevation_std_rad
    for place, angle in enumerate(np.flatnonzero(is_resolved)):
        variance = channel_errors.direction_variance_rad2[:, :, place]
        widened = np.minimum(np.sqrt(stds[angle] ** 2 + variance), limits[angle] / np.sqrt(3))
        stds[angle][:] = np.where(variance > 0, widened, stds[angle])


def _leave_out_unusable_angles(directions: Directions, aperture: Aperture) -> np.ndarray:
    """Set angles to NaN that the amplitudes do not determine, in place; return where, (n, source).

    Angles at the limit of the field of view, where the search ends but not the likelihood: the wave
    comes from beyond, or is not plane. And angles with a standard error of more than 22.5 degrees.
    """
    is_unknown = np.zeros(directions.azimuth_rad.shape, bool)
    for angle, std, max_sine in zip(
        directions[:2], directions[2:4], aperture.field_of_view.max_angle_sines, strict=True
    ):
        is_unusable = (abs(np.sin(angle)) >= _LIMIT_SHARE * max_sine) | (std > _MAX_STD_RAD)
        angle[is_unusable] = std[is_unusable] = np.nan
        is_unknown |= is_unusable
    return is_unknown
