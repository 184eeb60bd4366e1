"""Truth about a scene: the detections of an ideal radar."""

from typing import NamedTuple

import numpy as np
import pandas as pd  # type: ignore[import-untyped]
import xarray as xr
from numpy.typing import ArrayLike
from xarray.indexes import PandasIndex

import dechirp.core.accessor  # noqa: F401  # for `truth(...).dechirp`
from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.radar.budget import noise_power_w as thermal_noise_w
from dechirp.radar.budget import received_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.scene import Scene
from dechirp.scene.shadowing import target_shadow_losses


@check_argument_types
def truth(
    scene: Scene,
    radar: Radar,
    *,
    n_frames: int = 1,
    first_frame: int = 0,
    noise_power_w: float | None = None,
) -> xr.Dataset:
    """Return the detections of an ideal radar, with the columns of detections.

    Covers `n_frames` frames from the number `first_frame` on. `noise_power_w` is the noise in one
    sample; default: thermal noise of the hardware.

    Returns
    -------
    Dataset over (target, frame)
        `time` (s) of mid-frame, mid-window; `range` (m), `velocity` (m/s), `azimuth`,
        `elevation` (rad) at that instant, from the origin of the array; of a body, of the
        origin of its axes. `snr` after integration over samples, chirps and channels, for the
        mean cross sections of all its scatterers, if the hardware is given. `shadow_loss`, if
        bodies of the scene shadow: the two-way loss, a power ratio, included in `snr`.

    Raises
    ------
    InvalidSetting
        If a target sits on the radar, or `n_frames` or `first_frame` is invalid.

    Notes
    -----
    `velocity` is the rate of change of `range` at that instant, computed from the velocities of the
    target and of the radar, not from differences.
    """
    check_integer("n_frames", n_frames, at_least=1, at_most=1_000_000)
    check_integer("first", first_frame, at_least=0, at_most=1_000_000)
    frames = np.arange(first_frame, first_frame + n_frames)
    frame = radar.frame
    times_s = np.array(
        [frame.frame_start_s(i) + frame.for_frame(i).mid_frame_s for i in frames.tolist()]
    )
    geometry = _target_geometry(scene, times_s)
    columns = {
        "range": (geometry.range_m, "m"),
        "velocity": (geometry.velocity_m_per_s, "m/s"),
        "azimuth": (geometry.azimuth_rad, "rad"),
        "elevation": (geometry.elevation_rad, "rad"),
    }
    shadow_losses = target_shadow_losses(scene, times_s, frame.chirp.wavelength_m)
    if scene.has_shadows:
        columns["shadow_loss"] = (shadow_losses, "1")
    if radar.hardware is not None:
        noise_w = thermal_noise_w(radar) if noise_power_w is None else noise_power_w
        with np.errstate(divide="ignore", invalid="ignore"):  # the SNR is infinite without noise
            snr = (
                _received_powers_w(scene, radar, times_s, geometry)
                / shadow_losses
                / noise_w
                * radar.integration_gain
            )
        columns["snr"] = (snr, "1")
    dims = ("target", "frame")
    return xr.Dataset(
        {name: (dims, column.T, {"units": unit}) for name, (column, unit) in columns.items()},
        coords=_label_targets_and_frames(np.array(scene.names), frames, times_s),
    )


def _label_targets_and_frames(
    names: np.ndarray, frames: np.ndarray, times_s: np.ndarray
) -> xr.Coordinates:
    """Return the coordinates of both axes; of arrays, xarray would import pint, 0.1 s of CPU."""
    indexes = {
        axis: PandasIndex(pd.Index(values), axis, coord_dtype=values.dtype)
        for axis, values in (("target", names), ("frame", frames))
    }
    variables = {axis: index.create_variables()[axis] for axis, index in indexes.items()}
    variables["time"] = xr.Variable("frame", times_s, {"units": "s"})
    return xr.Coordinates(variables, indexes)


def echo_powers_w(scene: Scene, radar: Radar, times_s: ArrayLike) -> np.ndarray:
    """Return the mean power of each target's echo in one receiver, (n_times, n_targets)."""
    times_s = np.asarray(times_s, dtype=float)
    unshadowed_w = _received_powers_w(scene, radar, times_s, _target_geometry(scene, times_s))
    return unshadowed_w / target_shadow_losses(scene, times_s, radar.frame.chirp.wavelength_m)


class _TargetGeometry(NamedTuple):
    """Geometry of the targets relative to the radar, each (n_times, n_targets)."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray


def _target_geometry(scene: Scene, times_s: np.ndarray) -> _TargetGeometry:
    position_m = scene.target_positions_m(times_s)
    x, y, z = np.moveaxis(position_m, -1, 0)
    range_m = np.linalg.norm(position_m, axis=-1)
    _check_distances_from_radar(scene, range_m, times_s)
    radial_products = np.einsum("tni,tni->tn", position_m, scene.target_velocities_m_per_s(times_s))
    return _TargetGeometry(
        range_m, radial_products / range_m, np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    )


def _received_powers_w(
    scene: Scene, radar: Radar, times_s: np.ndarray, geometry: _TargetGeometry
) -> np.ndarray:
    return received_power_w(
        radar,
        range_m=geometry.range_m,
        rcs_m2=target_cross_sections_m2(scene, times_s, radar.frame.chirp.wavelength_m),
        azimuth_rad=geometry.azimuth_rad,
        elevation_rad=geometry.elevation_rad,
    )


def _check_distances_from_radar(scene: Scene, range_m: np.ndarray, times_s: np.ndarray) -> None:
    too_near = np.argwhere(range_m < 1e-6)  # the received power overflows at shorter distances
    if too_near.size:
        frame, target = too_near[0]
        raise InvalidSetting(
            f"scene.targets.{scene.names[target]}.position",
            value=f"at the radar after {format_si(times_s[frame], 's', 4)}",
            expected="a position with a direction from the radar",
            fix="move the target, or put the origin of its body among its scatterers",
        )
