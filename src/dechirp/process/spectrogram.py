"""Velocity over time: the micro-Doppler of parts that swing and turn."""

from itertools import pairwise

import numpy as np
import xarray as xr

from dechirp.core.checks import numbers, whole
from dechirp.core.conventions import CUBE_AXES, axis
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import must_fit
from dechirp.process.spectrum import Transform, range_profiles
from dechirp.process.virtual import channels
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window

# A body's parts are this near its strongest one: a bicycle is 1.7 m long.
_REACH_M = 2.0
# Of an interval, at 27 m/s and 35 us a phase of 0.003 rad at 77 GHz.
_NO_GAP = 1e-3


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
    r"""Short-time Fourier transform over slow time of what is within a range interval.

    .. math:: P(t, v) = \frac{1}{B_r K} \sum_{k, r} \left|\frac{\sum_m w_m\, p_{k r}(t + m T)
        \, e^{-4 \pi i v m T / \lambda}}{\sum_m w_m}\right|^2

    with range profiles p of K channels in the rows r of the interval, B_r the noise bandwidth
    of the range window in rows, and T from a chirp of a transmitter to its next. A steady echo
    in the interval peaks at its mean power in one channel. Where frames follow each other
    without a gap, windows reach across them; else each frame has its own, side by side.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        Complex or real samples; any order of axes.
    radar : Radar
        The waveform and the receivers that the cube was taken with.
    range_m : (float, float), optional
        Nearest and farthest row; without it 2 m on both sides of the strongest rows of the
        frames. Name it where echoes at rest are stronger.
    window : Window
        Over the chirps.
    n_window : int, optional
        Chirps of each transmitter in a window; those of a frame without it. Longer ones tell
        velocities finer, shorter ones times.
    hop : int, optional
        Chirps of each transmitter from a window to the next; a quarter of one without it.
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
        If the interval holds no range row, a window does not fit into the frames, the cube
        is not that radar's, or its frames have other intervals or ramps that fall.
    NotEnoughMemory
        If the profiles would not fit.

    References
    ----------
    V. C. Chen, The Micro-Doppler Effect in Radar, 2011, chapter 1.
    """
    must_be_of(cube, radar)
    frame, chirp = radar.frame, radar.frame.chirp
    over_range = Transform(window=range_window, n_points=chirp.n_samples, n_bins=chirp.n_samples)
    starts_s = frame_starts_s(cube, radar)
    runs = _runs(starts_s, radar)
    most = min(len(run) for run in runs) * frame.n_chirps
    n_window = frame.n_chirps if n_window is None else n_window
    whole("n_window", n_window, at_least=2, at_most=most)
    hop = max(n_window // 4, 1) if hop is None else hop
    whole("hop", hop, at_least=1)
    n_bins = n_window if n_velocity_bins is None else n_velocity_bins
    whole("n_velocity_bins", n_bins, at_least=n_window)
    over_velocity = Transform(window=window, n_points=n_window, n_bins=n_bins)
    rows = _rows(cube, radar, over_range, range_m)
    n_channels = radar.array.n_rx * frame.n_slots
    must_fit(
        "spectrogram",
        needed_bytes=8.0 * max(len(run) for run in runs) * frame.n_chirps * n_channels * len(rows),
        fix="Take a smaller range interval, or fewer frames.",
    )

    times_s, powers = [], []
    for run in runs:
        profiles = np.concatenate(
            [_profiles(cube, radar, over_range, index)[..., rows] for index in run]
        )
        firsts = np.arange(0, len(profiles) - n_window + 1, hop)
        powers += [_power(profiles[first : first + n_window], over_velocity) for first in firsts]
        middles = firsts + (n_window - 1) / 2
        slots_s = float(frame.slots_s.mean())  # from the first to the middle one
        first_s = starts_s[run[0]] + slots_s + chirp.mid_window_s
        times_s.append(first_s + middles * frame.repetition_s)
    power = np.array(powers) / over_range.noise_bandwidth_bins
    must_be_finite(power)
    units = "W" if cube.attrs.get("units") == "sqrt(W)" else "full scale squared"
    return xr.DataArray(
        power.astype(np.float32),
        dims=("time", "velocity"),
        coords={
            "time": xr.Variable(
                "time", np.concatenate(times_s), {"units": "s", "long_name": "middle of the window"}
            ),
            "velocity": axis("velocity", frame.velocity_bins_m_per_s(n_bins)),
        },
        attrs={"units": units, "long_name": "power"},
    )


def _power(profiles: np.ndarray, over_velocity: Transform) -> np.ndarray:
    """Power over velocity of one window, (chirp, channel, row): mean of channels, sum of rows."""
    weights = over_velocity.weights / over_velocity.weights.sum()
    spectrum = np.fft.fft(profiles * weights[:, None, None], over_velocity.n_bins, axis=0)
    power = (abs(spectrum) ** 2).sum(axis=-1).mean(axis=-1)
    return np.asarray(np.fft.fftshift(power))


def _profiles(cube: xr.DataArray, radar: Radar, over_range: Transform, index: int) -> np.ndarray:
    """Range profiles of one frame, (round, channel, row)."""
    one = cube.isel(frame=index).transpose("chirp", "rx", "sample")
    profiles = range_profiles(one, radar.frame.chirp, over_range).values
    return channels(profiles, radar.frame)


def _rows(
    cube: xr.DataArray,
    radar: Radar,
    over_range: Transform,
    range_m: tuple[float, float] | None,
) -> np.ndarray:
    """Places of the range rows within the interval."""
    bins_m = radar.frame.chirp.range_bins_m(over_range.n_bins)
    if range_m is None:
        powers = [
            (abs(_profiles(cube, radar, over_range, index)) ** 2).mean(axis=(0, 1))
            for index in range(cube.sizes["frame"])
        ]
        strongest_m = bins_m[np.argmax(powers, axis=1)]
        nearest_m, farthest_m = strongest_m.min() - _REACH_M, strongest_m.max() + _REACH_M
    else:
        ends_m = numbers("range_m", range_m)
        nearest_m, farthest_m = ends_m if ends_m.shape == (2,) else (np.inf, -np.inf)
    rows = np.flatnonzero((nearest_m <= bins_m) & (bins_m <= farthest_m))
    if not rows.size:
        raise InvalidSetting(
            "range_m",
            got=range_m,
            need=f"an interval that holds some of the range rows, which are"
            f" {bins_m[1] - bins_m[0]:.3g} m apart from 0 to {bins_m[-1]:.4g} m",
            fix="Give the nearest range, then the farthest.",
        )
    return rows


def frame_starts_s(cube: xr.DataArray, radar: Radar) -> np.ndarray:
    """When the frames of a cube begin, (n_frames,): its own times, or the radar's."""
    if "frame" in cube.coords:
        return np.asarray(cube.coords["frame"].values, dtype=float)
    return np.array([radar.frame.start_s(index) for index in range(cube.sizes["frame"])])


def _runs(starts_s: np.ndarray, radar: Radar) -> list[range]:
    """Frames between which there is no gap."""
    frame = radar.frame
    gaps_s = np.diff(starts_s) - frame.duration_s
    cuts = np.flatnonzero(abs(gaps_s) > _NO_GAP * frame.only_interval_s) + 1
    ends = [0, *cuts.tolist(), len(starts_s)]
    return [range(first, last) for first, last in pairwise(ends)]


def must_be_of(cube: xr.DataArray, radar: Radar) -> None:
    """Raise `InvalidSetting` unless the cube could be that radar's, of ramps that all rise."""
    frame = radar.frame
    if frame.falls:
        raise InvalidSetting(
            "radar.frame.modulation",
            got="triangular: rising and falling ramps see a moving target at two ranges",
            need="ramps that all rise",
            fix="Take every other chirp, cube.isel(chirp=slice(None, None, 2)), with"
            " radar.one_sided(): the rising ramps.",
        )
    if frame.n_intervals > 1:
        raise InvalidSetting(
            "radar.frame.interval_s",
            got=f"a list of {frame.n_intervals}, one for each frame in turn",
            need="one interval: the velocities of a row are those of one",
            fix=f"Take the frames of one interval, cube.isel(frame=slice(0, None,"
            f" {frame.n_intervals})), with radar.at(0).",
        )
    sizes = (frame.n_sent, radar.array.n_rx, frame.chirp.n_samples)
    need = dict(zip(CUBE_AXES[1:], sizes, strict=True))
    got = {str(name): size for name, size in cube.sizes.items()}
    is_complex = np.issubdtype(cube.dtype, np.complexfloating)
    right_kind = is_complex == (frame.chirp.sampling == "complex")
    if {"frame": got.get("frame"), **need} != got or not got["frame"] or not right_kind:
        raise InvalidSetting(
            "cube",
            got=f"of {got} and the type {cube.dtype}",
            need=f"of frames and {need}, {frame.chirp.sampling}, as the radar has",
            fix="Give the radar that the cube was taken with, and name the axes so.",
        )


def must_be_finite(made: np.ndarray) -> None:
    """Raise `InvalidSetting` if what was made of the samples of a cube says that some are not."""
    if not np.isfinite(made).all():
        raise InvalidSetting(
            "cube",
            got="samples that are not finite (NaN or infinite)",
            need="finite samples throughout",
            fix="Find what wrote them, or replace them by zeros.",
        )
