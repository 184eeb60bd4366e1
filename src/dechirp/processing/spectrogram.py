"""Spectrogram over slow time: micro-Doppler of swinging and rotating parts."""

from itertools import pairwise

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array, check_integer
from dechirp.core.conventions import CUBE_AXES, axis_coordinate
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.core.units import power_units
from dechirp.processing.scaling import check_fits_single_precision
from dechirp.processing.spectrum import Transform, range_profiles
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window

# Largest distance of the parts of a body from its strongest one: a bicycle is 1.7 m long.
_BODY_EXTENT_M = 2.0
# Gap that counts as none, over an interval: at 27 m/s and 35 us a phase of 0.003 rad at 77 GHz.
_MAX_GAP = 1e-3


@check_argument_types
def spectrogram(
    cube: xr.DataArray,
    radar: Radar,
    *,
    range_m: tuple[float, float] | None = None,
    window: Window = "hann",
    n_window: int | None = None,
    hop: int | None = None,
    n_velocity_bins: int | None = None,
    range_window: Window = "hann",
) -> xr.DataArray:
    r"""Compute the short-time Fourier transform over slow time within a range interval.

    .. math:: P(t, v) = \frac{1}{B_r K} \sum_{k, r} \left|\frac{\sum_m w_m\, p_{k r}(t + m T)
        \, e^{-4 \pi i v m T / \lambda}}{\sum_m w_m}\right|^2

    with range profiles p of K channels in the rows r of the interval, B_r the noise bandwidth
    of the range window in rows, and T from a chirp of a transmitter to its next. A steady echo
    in the interval peaks at its mean power in one channel. If frames follow each other
    without a gap, windows extend across them; otherwise each frame has its own windows.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        Complex or real samples; any order of axes.
    radar : Radar
        The waveform and the receivers that the cube was taken with.
    range_m : (float, float), optional
        Nearest and farthest row; by default 2 m on both sides of the strongest rows of the
        frames. Specify it if static echoes are stronger.
    window : Window
        Over the chirps.
    n_window : int, optional
        Chirps of each transmitter in a window; those of a frame by default. Longer windows
        resolve velocity better, shorter ones time.
    hop : int, optional
        Chirps of each transmitter from one window to the next; a quarter of a window by default.
    n_velocity_bins : int, optional
        Points of the transform, zero-padded above n_window, which is the default.
    range_window : Window
        Over the samples.

    Returns
    -------
    DataArray (time, velocity), W
        `time` (s): middle of each window, as estimates refer to mid-frame; `velocity` (m/s),
        receding positive. Of uncalibrated samples, in full scale squared.

    Raises
    ------
    InvalidSetting
        If the interval contains no range row, a window does not fit into the frames, the cube
        does not fit the radar, or its frames have several intervals or falling ramps.
    NotEnoughMemory
        If the profiles would not fit.

    References
    ----------
    V. C. Chen, The Micro-Doppler Effect in Radar, 2011, chapter 1.
    """
    check_cube_fits_rising_ramp_radar(cube, radar)
    frame, chirp = radar.frame, radar.frame.chirp
    range_transform = Transform(
        window=range_window, n_points=chirp.n_samples, n_bins=chirp.n_samples
    )
    starts_s = frame_starts_s(cube, radar)
    runs = _gapless_frame_runs(starts_s, radar)
    most = min(len(run) for run in runs) * frame.n_chirps
    n_window = frame.n_chirps if n_window is None else n_window
    check_integer("n_window", n_window, at_least=2, at_most=most)
    hop = max(n_window // 4, 1) if hop is None else hop
    check_integer("hop", hop, at_least=1)
    n_bins = n_window if n_velocity_bins is None else n_velocity_bins
    check_integer("n_velocity_bins", n_bins, at_least=n_window)
    doppler_transform = Transform(window=window, n_points=n_window, n_bins=n_bins)
    rows = _rows_around_range_or_strongest_echo(cube, radar, range_transform, range_m)
    n_channels = radar.array.n_rx * frame.n_slots
    check_free_memory(
        "spectrogram",
        needed_bytes=8.0 * max(len(run) for run in runs) * frame.n_chirps * n_channels * len(rows),
        fix="take a smaller range interval, or fewer frames",
    )

    times_s, powers = [], []
    for run in runs:
        profiles = np.concatenate(
            [_frame_range_profiles(cube, radar, range_transform, index)[..., rows] for index in run]
        )
        firsts = np.arange(0, len(profiles) - n_window + 1, hop)
        powers += [
            _velocity_power_of_window(profiles[first : first + n_window], doppler_transform)
            for first in firsts
        ]
        middles = firsts + (n_window - 1) / 2
        slots_s = float(frame.slot_starts_s.mean())  # from the first to the middle one
        first_s = starts_s[run[0]] + slots_s + chirp.mid_window_s
        times_s.append(first_s + middles * frame.repetition_s)
    power = np.array(powers) / range_transform.noise_bandwidth_bins
    check_finite(power)
    units = power_units(cube.attrs.get("units"))
    return xr.DataArray(
        power.astype(np.float32),
        dims=("time", "velocity"),
        coords={
            "time": xr.Variable(
                "time", np.concatenate(times_s), {"units": "s", "long_name": "middle of the window"}
            ),
            "velocity": axis_coordinate("velocity", frame.velocity_bins_m_per_s(n_bins)),
        },
        attrs={"units": units, "long_name": "power"},
    )


def _velocity_power_of_window(profiles: np.ndarray, doppler_transform: Transform) -> np.ndarray:
    """Compute the power over velocity of one window: mean of channels, sum of rows."""
    weights = doppler_transform.weights / doppler_transform.weights.sum()
    spectrum = np.fft.fft(profiles * weights[:, None, None], doppler_transform.n_bins, axis=0)
    power = (abs(spectrum) ** 2).sum(axis=-1).mean(axis=-1)
    return np.asarray(np.fft.fftshift(power))


def _frame_range_profiles(
    cube: xr.DataArray, radar: Radar, range_transform: Transform, index: int
) -> np.ndarray:
    """Compute the range profiles of one frame, (round, channel, row)."""
    samples = cube.isel(frame=index).transpose("chirp", "rx", "sample")
    profiles = range_profiles(samples, radar.frame.chirp, range_transform).values
    return split_chirps_into_slots(profiles, radar.frame)


def _rows_around_range_or_strongest_echo(
    cube: xr.DataArray,
    radar: Radar,
    range_transform: Transform,
    range_m: tuple[float, float] | None,
) -> np.ndarray:
    """Return the indices of the range rows within the interval."""
    bins_m = radar.frame.chirp.range_bins_m(range_transform.n_bins)
    if range_m is None:
        powers = [
            (abs(_frame_range_profiles(cube, radar, range_transform, index)) ** 2).mean(axis=(0, 1))
            for index in range(cube.sizes["frame"])
        ]
        strongest_m = bins_m[np.argmax(powers, axis=1)]
        nearest_m, farthest_m = (
            strongest_m.min() - _BODY_EXTENT_M,
            strongest_m.max() + _BODY_EXTENT_M,
        )
    else:
        ends_m = check_finite_array("range_m", range_m)
        nearest_m, farthest_m = ends_m if ends_m.shape == (2,) else (np.inf, -np.inf)
    rows = np.flatnonzero((nearest_m <= bins_m) & (bins_m <= farthest_m))
    if not rows.size:
        raise InvalidSetting(
            "range_m",
            value=range_m,
            expected=f"an interval with some of the range rows, which are"
            f" {bins_m[1] - bins_m[0]:.3g} m apart from 0 to {bins_m[-1]:.4g} m",
            fix="give the nearest range, then the farthest",
        )
    return rows


def frame_starts_s(cube: xr.DataArray, radar: Radar) -> np.ndarray:
    """Return the start times of the frames, (n_frames,), of the cube or else of the radar."""
    if "frame" in cube.coords:
        return np.asarray(cube.coords["frame"].values, dtype=float)
    return np.array([radar.frame.frame_start_s(index) for index in range(cube.sizes["frame"])])


def _gapless_frame_runs(starts_s: np.ndarray, radar: Radar) -> list[range]:
    """Group the frames into runs without a gap between them."""
    frame = radar.frame
    gaps_s = np.diff(starts_s) - frame.duration_s
    cuts = np.flatnonzero(abs(gaps_s) > _MAX_GAP * frame.single_interval_s) + 1
    ends = [0, *cuts.tolist(), len(starts_s)]
    return [range(first, last) for first, last in pairwise(ends)]


def check_cube_fits_rising_ramp_radar(cube: xr.DataArray, radar: Radar) -> None:
    """Raise `InvalidSetting` unless the cube fits the radar and all ramps rise.

    Its samples must also be within single precision.
    """
    frame = radar.frame
    if frame.has_falling_ramps:
        raise InvalidSetting(
            "radar.frame.modulation",
            value="triangular: rising and falling ramps measure a moving target at two ranges",
            expected="rising ramps only",
            fix="take every other chirp, cube.isel(chirp=slice(None, None, 2)), with"
            " radar.with_rising_ramps_only(): the rising ramps",
        )
    if frame.n_intervals > 1:
        raise InvalidSetting(
            "radar.frame.interval_s",
            value=f"{frame.n_intervals} intervals in turn",
            expected="one interval, since the velocity axis depends on it",
            fix=f"take the frames of one interval, cube.isel(frame=slice(0, None,"
            f" {frame.n_intervals})), with radar.for_frame(0)",
        )
    sizes = (frame.n_chirps_total, radar.array.n_rx, frame.chirp.n_samples)
    expected = dict(zip(CUBE_AXES[1:], sizes, strict=True))
    sizes_of_cube = {str(name): size for name, size in cube.sizes.items()}
    is_complex = np.issubdtype(cube.dtype, np.complexfloating)
    has_sampling = is_complex == (frame.chirp.sampling == "complex")
    if (
        {"frame": sizes_of_cube.get("frame"), **expected} != sizes_of_cube
        or not sizes_of_cube["frame"]
        or not has_sampling
    ):
        raise InvalidSetting(
            "cube",
            value=f"{sizes_of_cube} of type {cube.dtype}",
            expected=f"frames and {expected}, {frame.chirp.sampling}, as the radar has",
            fix="pass the radar that the cube was taken with, and rename the axes",
        )
    if cube.dtype in (np.float64, np.complex128):
        for index in range(cube.sizes["frame"]):  # a lazy cube may exceed the memory
            check_fits_single_precision(cube.isel(frame=index).values)


def check_finite(values: np.ndarray) -> None:
    """Raise `InvalidSetting` if values computed from a cube are not finite."""
    if not np.isfinite(values).all():
        raise InvalidSetting(
            "cube",
            value="samples that are not finite (NaN or infinite)",
            expected="finite samples throughout",
            fix="find what wrote them, or replace them by zeros",
        )
