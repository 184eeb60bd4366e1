"""The truth about a scene: what a perfect radar would report."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

import dechirp.core.accessor  # noqa: F401  # for `truth(...).dechirp`
from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.radar.budget import noise_power_w as thermal_noise_w
from dechirp.radar.budget import received_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.scene import Scene


def truth(
    scene: Scene,
    radar: Radar,
    *,
    n_frames: int = 1,
    first: int = 0,
    noise_power_w: float | None = None,
) -> xr.Dataset:
    """What a perfect radar would report, in the words of detections.

    Of `n_frames` from the one of number `first` on. `noise_power_w` is the noise in one sample;
    thermal noise of the hardware without it.

    Returns
    -------
    Dataset over (target, frame)
        `time` (s) of mid-frame, mid-window; `range` (m), `velocity` (m/s), `azimuth`,
        `elevation` (rad) at that instant, seen from the origin of the array; of a body, of the
        origin of its axes. `snr` after integration over samples, chirps and channels, of the
        mean cross sections of all its scatterers, where the hardware is known.

    Raises
    ------
    InvalidSetting
        If a target sits on the radar, or `n_frames` or `first` is no number of frames.

    Notes
    -----
    `velocity` is the rate of change of `range` at that instant, from the velocities of the
    target and of the radar: no differences are taken.
    """
    whole("n_frames", n_frames, at_least=1, at_most=1_000_000)
    whole("first", first, at_least=0, at_most=1_000_000)
    frames = np.arange(first, first + n_frames)
    frame = radar.frame
    times_s = np.array([frame.start_s(i) + frame.at(i).mid_frame_s for i in frames.tolist()])
    seen = _seen(scene, times_s)
    told = {
        "range": (seen.range_m, "m"),
        "velocity": (seen.velocity_m_per_s, "m/s"),
        "azimuth": (seen.azimuth_rad, "rad"),
        "elevation": (seen.elevation_rad, "rad"),
    }
    if radar.hardware is not None:
        noise_w = thermal_noise_w(radar) if noise_power_w is None else noise_power_w
        with np.errstate(divide="ignore", invalid="ignore"):  # without noise it is infinite
            snr = _echo_powers_w(scene, radar, times_s, seen) / noise_w * radar.integration_gain
        told["snr"] = (snr, "1")
    over = ("target", "frame")
    return xr.Dataset(
        {name: (over, column.T, {"units": unit}) for name, (column, unit) in told.items()},
        coords={
            "target": ("target", list(scene.names)),
            "frame": ("frame", frames),
            "time": ("frame", times_s, {"units": "s"}),
        },
    )


def echo_powers_w(scene: Scene, radar: Radar, times_s: ArrayLike) -> np.ndarray:
    """Mean power of each target's echo in one receiver at each time, (n_times, n_targets)."""
    times_s = np.asarray(times_s, dtype=float)
    return _echo_powers_w(scene, radar, times_s, _seen(scene, times_s))


class _Seen(NamedTuple):
    """Targets, as the radar sees them, each (n_times, n_targets)."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray


def _seen(scene: Scene, times_s: np.ndarray) -> _Seen:
    position_m = scene.target_positions_m(times_s)
    x, y, z = np.moveaxis(position_m, -1, 0)
    range_m = np.linalg.norm(position_m, axis=-1)
    _must_be_away(scene, range_m, times_s)
    along = np.einsum("tni,tni->tn", position_m, scene.target_velocities_m_per_s(times_s))
    return _Seen(range_m, along / range_m, np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))


def _echo_powers_w(scene: Scene, radar: Radar, times_s: np.ndarray, seen: _Seen) -> np.ndarray:
    return received_power_w(
        radar,
        range_m=seen.range_m,
        rcs_m2=target_cross_sections_m2(scene, times_s, radar.frame.chirp.wavelength_m),
        azimuth_rad=seen.azimuth_rad,
        elevation_rad=seen.elevation_rad,
    )


def _must_be_away(scene: Scene, range_m: np.ndarray, times_s: np.ndarray) -> None:
    near = np.argwhere(range_m < 1e-6)  # nearer, its power overflows
    if near.size:
        frame, target = near[0]
        raise InvalidSetting(
            f"scene.targets.{scene.names[target]}.position",
            got=f"on the radar after {times_s[frame]:.4g} s",
            need="away from it: it has no direction there",
            fix="Move the target, or put the origin of its body among its scatterers.",
        )
