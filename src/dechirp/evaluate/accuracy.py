"""How well the targets of a case can be measured: Cramer-Rao bounds."""

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.evaluate.gates import turns
from dechirp.evaluate.look import Case
from dechirp.evaluate.match import CELLS
from dechirp.process.angle.aperture import Aperture
from dechirp.process.sources import aperture_of
from dechirp.radar.accuracy import standard_errors
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place
from dechirp.theory.direction_bounds import direction_std_rad

AXES = ("range", "velocity", "azimuth", "elevation")

# A line tells the angle of a cone: where that is off the angle itself by more of its standard
# error, the bound is not that of the error.
_MOST_OFF = 0.1
_NOTHING = 1e-300


def smallest_errors(case: Case) -> dict[str, np.ndarray]:
    """Smallest root mean square error of each target on each axis, m, m/s or rad, (n_targets,).

    The Cramer-Rao bound at the ratio of the truth, its variance the mean over frames: what no
    unbiased estimate of one frame beats. The standard errors of detections are larger: powers of
    K channels are added, which costs 1 + K / snr times the variance. Below 15 dB errors are larger
    than both, see `theory.bounds`. Errors count where a target is found, and noise that lifts a
    faint one over the threshold tells too: there they may be smaller.

    NaN where no bound holds: of bodies and of targets that fluctuate; with samples cleaned, or
    other noise than white; within two cells of another target; and of directions that the array
    or the chain does not tell, that lie outside the field of view, or of which a line tells
    another angle than that asked for.
    """
    n_targets, n_frames = len(case.names), len(case.times_s)
    found = np.full((len(AXES), n_targets, n_frames), np.nan)
    white = np.isfinite(case.noise_power_w) and case.noise_power_w > 0
    if white and "snr" in case.truth and not case.chain.mitigation:
        aperture = _aperture(case)
        known = case.truth.transpose("target", "frame")
        for at in range(n_frames):
            found[:, :, at] = _in_frame(case, known.isel(frame=at), aperture)
    own = [target.body is None and target.fluctuation == "steady" for target in case.scene.targets]
    found[:, ~np.array(own, dtype=bool)] = np.nan
    found[~np.isfinite(found)] = np.nan
    return dict(zip(AXES, np.sqrt(np.mean(found**2, axis=-1)), strict=True))


def _aperture(case: Case) -> Aperture | None:
    if case.chain.angle is None:
        return None
    try:
        return aperture_of(case.radar, case.chain.field_of_view)
    except InvalidSetting:
        return None


def _in_frame(case: Case, known: xr.Dataset, aperture: Aperture | None) -> np.ndarray:
    """Bounds in one frame, (4, n_targets)."""
    # In the null of an antenna there is nothing to measure: the bound is infinite.
    radar, snr = case.radar.at(int(known.frame)), np.maximum(known.snr.values, _NOTHING)
    found = np.full((len(AXES), len(snr)), np.nan)
    found[:2] = standard_errors(radar.frame, snr=snr)
    if aperture is not None:
        angles = zip(known.azimuth.values, known.elevation.values, snr, strict=True)
        found[2:] = np.transpose([_of_angles(*one, radar, aperture) for one in angles])
    found[:, _beside_others(known, radar)] = np.nan
    return found


def _of_angles(
    azimuth: float, elevation: float, snr: float, radar: Radar, aperture: Aperture
) -> np.ndarray:
    """Of azimuth and elevation, (2,)."""
    bounds = direction_std_rad(
        positions=aperture.positions,
        azimuth_rad=[azimuth],
        elevation_rad=elevation,
        amplitudes=[np.sqrt(snr / radar.n_channels)],
        noise_power=1.0,
        tells=aperture.tells,
    )[0]
    view = aperture.field_of_view
    seen = abs(azimuth) <= view.azimuth_rad and abs(elevation) <= view.elevation_rad
    if aperture.tells == (True, True):
        return bounds if seen else np.full(2, np.nan)
    told = aperture.tells.index(True)
    angle, other = (azimuth, elevation) if told == 0 else (elevation, azimuth)
    cone = np.arcsin(np.sin(angle) * np.cos(other)) if told == 0 else angle
    is_told = seen and abs(cone - angle) <= _MOST_OFF * bounds[told]
    return np.where(np.array(aperture.tells) & is_told, bounds, np.nan)


def _beside_others(known: xr.Dataset, radar: Radar) -> np.ndarray:
    """Whether another target is within two cells of range and velocity, bool (n_targets,)."""
    frame = radar.frame
    fast, slow = turns(Place(known.range.values, known.velocity.values), radar)
    apart = [abs(one[:, None] - one) % 1.0 for one in (fast, slow)]
    in_cells = [
        np.minimum(one, 1 - one) * n
        for one, n in zip(apart, (frame.chirp.n_samples, frame.n_chirps), strict=True)
    ]
    near = np.maximum(*in_cells) <= CELLS
    return np.asarray(near.sum(axis=1) > 1)
