"""Cramer-Rao bounds of the targets of a trial."""

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.evaluation.association import GATE_CELLS
from dechirp.evaluation.gates import echo_cycles_per_sample_and_chirp
from dechirp.evaluation.trial import TrialContext
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.direction_finding import checked_direction_aperture
from dechirp.radar.estimation_bounds import range_and_velocity_crlb_std
from dechirp.radar.radar import Radar
from dechirp.scene.aliasing import RangeVelocity
from dechirp.theory.direction_bounds import direction_std_rad

AXES = ("range", "velocity", "azimuth", "elevation")

# A linear array measures a cone angle: if it differs from the angle itself by more than this
# fraction of the standard error, the bound does not apply.
_MAX_CONE_ERROR = 0.1
_MIN_SNR = 1e-300


def rms_error_bounds(context: TrialContext) -> dict[str, np.ndarray]:
    """Return the smallest RMS error of each target on each axis, m, m/s or rad, (n_targets,).

    The Cramer-Rao bound at the true signal-to-noise ratio, its variance averaged over frames: no
    unbiased estimate of one frame is better. The standard errors of detections are larger: powers
    of K channels are added, which multiplies the variance by 1 + K / snr. Below 15 dB errors exceed
    both, see `theory.bounds`. Errors only count for detected targets; for weak ones, whose
    detection depends on the noise, they may be smaller than the bound.

    NaN where no bound holds: for bodies and fluctuating targets; with mitigation, or noise that is
    not white; within two cells of another target; and for directions that the array or the chain
    does not resolve, that lie outside the field of view, or for which a linear array measures a
    different angle.
    """
    n_targets, n_frames = len(context.target_names), len(context.times_s)
    bounds = np.full((len(AXES), n_targets, n_frames), np.nan)
    has_white_noise = np.isfinite(context.noise_power_w) and context.noise_power_w > 0
    if has_white_noise and "snr" in context.truth and not context.chain.mitigation:
        aperture = _direction_aperture_or_none(context)
        truth = context.truth.transpose("target", "frame")
        for frame_index in range(n_frames):
            bounds[:, :, frame_index] = _frame_error_bounds(
                context, truth.isel(frame=frame_index), aperture
            )
    is_steady_point = [
        target.body is None and target.fluctuation == "steady" for target in context.scene.targets
    ]
    bounds[:, ~np.array(is_steady_point, dtype=bool)] = np.nan
    bounds[~np.isfinite(bounds)] = np.nan
    return dict(zip(AXES, np.sqrt(np.mean(bounds**2, axis=-1)), strict=True))


def _direction_aperture_or_none(context: TrialContext) -> Aperture | None:
    if context.chain.angle is None:
        return None
    try:
        return checked_direction_aperture(context.radar, context.chain.field_of_view)
    except InvalidSetting:
        return None


def _frame_error_bounds(
    context: TrialContext, truth: xr.Dataset, aperture: Aperture | None
) -> np.ndarray:
    """Return the bounds in one frame, (4, n_targets)."""
    # In the null of an antenna the bound is infinite.
    radar, snr = context.radar.for_frame(int(truth.frame)), np.maximum(truth.snr.values, _MIN_SNR)
    bounds = np.full((len(AXES), len(snr)), np.nan)
    if not len(snr):
        return bounds
    bounds[:2] = range_and_velocity_crlb_std(radar.frame, snr=snr)
    if aperture is not None:
        angles = zip(truth.azimuth.values, truth.elevation.values, snr, strict=True)
        bounds[2:] = np.transpose(
            [_angle_error_bounds(*target_values, radar, aperture) for target_values in angles]
        )
    bounds[:, _mask_of_targets_near_another(truth, radar)] = np.nan
    return bounds


def _angle_error_bounds(
    azimuth: float, elevation: float, snr: float, radar: Radar, aperture: Aperture
) -> np.ndarray:
    """Return the bounds of azimuth and elevation, (2,)."""
    bounds = direction_std_rad(
        positions=aperture.positions,
        azimuth_rad=[azimuth],
        elevation_rad=elevation,
        amplitudes=[np.sqrt(snr / radar.n_channels)],
        noise_power=1.0,
        unknown=aperture.resolves_azimuth_and_elevation,
    )[0]
    view = aperture.field_of_view
    is_in_view = abs(azimuth) <= view.azimuth_rad and abs(elevation) <= view.elevation_rad
    if aperture.resolves_azimuth_and_elevation == (True, True):
        return bounds if is_in_view else np.full(2, np.nan)
    axis = aperture.resolves_azimuth_and_elevation.index(True)
    angle, other = (azimuth, elevation) if axis == 0 else (elevation, azimuth)
    cone = np.arcsin(np.sin(angle) * np.cos(other)) if axis == 0 else angle
    is_resolved = is_in_view and abs(cone - angle) <= _MAX_CONE_ERROR * bounds[axis]
    return np.where(np.array(aperture.resolves_azimuth_and_elevation) & is_resolved, bounds, np.nan)


def _mask_of_targets_near_another(truth: xr.Dataset, radar: Radar) -> np.ndarray:
    """Return True for targets within two cells of another in range and velocity, (n_targets,)."""
    frame = radar.frame
    fast, slow = echo_cycles_per_sample_and_chirp(
        RangeVelocity(truth.range.values, truth.velocity.values), radar
    )
    distances = [abs(frequencies[:, None] - frequencies) % 1.0 for frequencies in (fast, slow)]
    in_cells = [
        np.minimum(frequencies, 1 - frequencies) * n
        for frequencies, n in zip(distances, (frame.chirp.n_samples, frame.n_chirps), strict=True)
    ]
    is_near = np.maximum(*in_cells) <= GATE_CELLS
    return np.asarray(is_near.sum(axis=1) > 1)
