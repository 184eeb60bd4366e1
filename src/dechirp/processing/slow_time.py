r"""Displacement from the phase of one range cell over slow time.

A target at R has the beat phase

.. math:: \varphi = \frac{4\pi f R}{c}

at the middle of the sampling window, f the frequency sent there: half a wavelength, 2 mm at
77 GHz, is a cycle. So the phase resolves micrometres, where range cells are centimetres wide, up to
whole cycles: from one value to the next a target may move at most a quarter of a wavelength.

White noise gives displacements a standard deviation of lambda / (4 pi sqrt(2 S)), S the SNR in the
cell. A static target in the same cell adds a constant to the trace and biases the phase towards
its own: displacements become too small, or distorted.

References
----------
C. Li, V. M. Lubecke, O. Boric-Lubecke and J. Lin, A review on recent advances in Doppler radar
sensors for noncontact healthcare monitoring, IEEE Trans. MTT 61(5), 2013.
"""

import warnings

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import format_si
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.peak_interpolation import tone_bin_offsets
from dechirp.processing.spectrogram import (
    check_cube_fits_rising_ramp_radar,
    check_finite,
    frame_starts_s,
)
from dechirp.processing.spectrum import Transform, amplitude_range_weights, range_profiles
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window

__all__ = [
    "displacement",
    "displacement_spectrum",
    "frame_means",
    "range_traces",
    "range_track",
    "slow_time",
    "strongest_oscillation",
]


def __dir__() -> list[str]:
    return __all__


# Phase steps between values of a trace beyond this are ambiguous: at an SNR of 15 dB (0.13 rad) the
# margin from three quarters of half a cycle to half a cycle is six standard deviations.
_MAX_PHASE_STEP = 0.75 * np.pi
# A chest at 20 mm/s moves 0.4 mm in this time: 0.08 of a half wavelength at 60 GHz.
_MAX_AVERAGING_S = 0.02
_RANGE_OVERSAMPLING = 8  # bins per resolution cell: straddling loss 0.06 dB


@check_argument_types
def slow_time(
    cube: xr.DataArray, radar: Radar, range_m: ArrayLike, *, window: Window = "hann"
) -> xr.DataArray:
    """Extract the complex slow-time trace of one range, chirp by chirp.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        Complex or real samples; any order of axes.
    radar : Radar
        The waveform and the receivers that the cube was taken with.
    range_m : number, or array (time,)
        One range, or one for each round of each frame, to follow a target (`range_track`). Any
        range, not only those of rows: the phase refers to the middle of the sampling window,
        where it does not depend on it.
    window : Window
        Over the samples; suppresses other ranges.

    Returns
    -------
    DataArray (time, channel), complex
        A steady echo has the magnitude of its amplitude. `time` (s): mid-window of the middle
        slot of each round; `frame`, on the same axis, its frame; `channel` is
        slot * n_rx + rx, see `processing.virtual_array.split_chirps_into_slots`.

    Raises
    ------
    InvalidSetting
        If a range is outside the range axis, the cube does not fit the radar, or some of its
        samples are not finite.
    """
    check_cube_fits_rising_ramp_radar(cube, radar)
    frame, chirp = radar.frame, radar.frame.chirp
    n_rounds = cube.sizes["frame"] * frame.n_chirps
    ranges_m = check_finite_array("range_m", range_m)
    farthest_m = float(chirp.range_bins_m(chirp.n_samples)[-1])
    if (
        ranges_m.shape not in {(), (n_rounds,)}
        or not ((ranges_m >= 0) & (ranges_m <= farthest_m)).all()
    ):
        raise InvalidSetting(
            "range_m",
            value=range_m if ranges_m.ndim == 0 else f"an array of shape {ranges_m.shape}",
            expected=f"one number, or {n_rounds}, one for each round, from 0 to {farthest_m:.4g} m",
            fix="give the range of a target, or what range_track returns",
        )
    transform = Transform(window=window, n_points=chirp.n_samples, n_bins=chirp.n_samples)
    weights = amplitude_range_weights(transform, chirp.sampling)
    cycles = (
        chirp.beat_frequency_hz(1.0) / chirp.sample_rate_hz * np.broadcast_to(ranges_m, n_rounds)
    )
    from_middle = np.arange(chirp.n_samples) - (chirp.n_samples - 1) / 2
    traces = []
    for index, round_cycles in enumerate(cycles.reshape(-1, frame.n_chirps)):
        samples = cube.isel(frame=index).transpose("chirp", "rx", "sample").values
        steering = np.exp(-2j * np.pi * round_cycles[:, None] * from_middle) * weights
        traces.append(
            np.einsum(
                "mkn,mn->mk", split_chirps_into_slots(samples, frame), steering.astype(np.complex64)
            )
        )
        check_finite(traces[-1])
    units = cube.attrs.get("units", "1")
    return xr.DataArray(
        np.concatenate(traces).astype(np.complex64),
        dims=("time", "channel"),
        coords=_round_times_and_frames(cube, radar),
        attrs={"units": units, "long_name": "amplitude"},
    )


@check_argument_types
def range_track(
    cube: xr.DataArray, radar: Radar, range_m: tuple[float, float], *, window: Window = "hann"
) -> xr.DataArray:
    """Track the range of the strongest echo within an interval, round by round.

    Parameters
    ----------
    cube, radar, window
        See `slow_time`.
    range_m : (float, float)
        Nearest and farthest.

    Returns
    -------
    DataArray (time,), m
        Of the highest point of the power over range, mean of the channels, interpolated
        between rows. A target that moves at v appears v f / S too far, as in any single chirp.

    Raises
    ------
    InvalidSetting
        If the interval contains fewer than three points, the cube does not fit the radar, or some
        of its samples are not finite.
    """
    check_cube_fits_rising_ramp_radar(cube, radar)
    frame, chirp = radar.frame, radar.frame.chirp
    transform = Transform(
        window=window, n_points=chirp.n_samples, n_bins=_RANGE_OVERSAMPLING * chirp.n_samples
    )
    bins_m = chirp.range_bins_m(transform.n_bins)
    rows = _rows_of_interval(
        range_m, bins_m, at_least=3, interval=f"an interval of {2 * bins_m[1]:.3g} m or more"
    )
    tracks = []
    for index in range(cube.sizes["frame"]):
        samples = cube.isel(frame=index).transpose("chirp", "rx", "sample")
        profiles = split_chirps_into_slots(
            range_profiles(samples, chirp, transform).values[..., rows], frame
        )
        power = (abs(profiles) ** 2).mean(axis=1)
        check_finite(power)
        top = np.clip(np.argmax(power, axis=1), 1, rows.size - 2)
        round_ = np.arange(len(power))
        lower, centre, upper = (power[round_, top + step] for step in (-1, 0, 1))
        tracks.append(bins_m[1] * (rows[top] + tone_bin_offsets(lower, centre, upper, transform)))
    return xr.DataArray(
        np.concatenate(tracks),
        dims=("time",),
        coords=_round_times_and_frames(cube, radar),
        attrs={"units": "m", "long_name": "range"},
    )


@check_argument_types
def range_traces(
    cube: xr.DataArray, radar: Radar, range_m: tuple[float, float], *, window: Window = "hann"
) -> xr.DataArray:
    """Extract the slow-time traces of all range rows of an interval, averaged over 20 ms.

    Parameters
    ----------
    cube, radar, window
        See `slow_time`.
    range_m : (float, float)
        Nearest and farthest.

    Returns
    -------
    DataArray (time, range, channel), complex
        Means over the rounds within 20 ms, at least one for each frame; otherwise as
        `slow_time`. The attribute `wavelength_m` converts phase to displacement.

    Raises
    ------
    InvalidSetting
        If the interval contains no row, the cube does not fit the radar, or some of its samples
        are not finite.
    """
    check_cube_fits_rising_ramp_radar(cube, radar)
    frame, chirp = radar.frame, radar.frame.chirp
    transform = Transform(window=window, n_points=chirp.n_samples, n_bins=chirp.n_samples)
    bins_m = chirp.range_bins_m(transform.n_bins)
    rows = _rows_of_interval(
        range_m,
        bins_m,
        at_least=1,
        interval=f"an interval with a row, {bins_m[1]:.3g} m apart",
    )
    starts = np.arange(0, frame.n_chirps, max(int(_MAX_AVERAGING_S / frame.repetition_s), 1))
    n_rounds = np.diff(starts, append=frame.n_chirps)
    means = []
    for index in range(cube.sizes["frame"]):
        samples = cube.isel(frame=index).transpose("chirp", "rx", "sample")
        profiles = range_profiles(samples, chirp, transform).values[..., rows]
        check_finite(profiles)
        sums = np.add.reduceat(split_chirps_into_slots(profiles, frame), starts, axis=0)
        means.append(np.moveaxis(sums / n_rounds[:, None, None], 2, 1))
    times_s = _round_times_and_frames(cube, radar)["time"].values.reshape(-1, frame.n_chirps)
    return xr.DataArray(
        np.concatenate(means).astype(np.complex64),
        dims=("time", "range", "channel"),
        coords={
            "time": xr.Variable(
                "time",
                (np.add.reduceat(times_s, starts, axis=1) / n_rounds).ravel(),
                {"units": "s", "long_name": "time"},
            ),
            "range": xr.Variable("range", bins_m[rows], {"units": "m"}),
        },
        attrs={
            "units": cube.attrs.get("units", "1"),
            "long_name": "amplitude",
            "wavelength_m": SPEED_OF_LIGHT / chirp.mean_sampled_frequency_hz,
        },
    )


@check_argument_types
def frame_means(trace: xr.DataArray) -> xr.DataArray:
    """Average a trace over the rounds of each frame, (time, channel), one value per frame.

    For frames that are short bursts of chirps: times are then spaced like frames, and the noise
    falls by the number of rounds. A target must move much less than a wavelength within a frame.

    Parameters
    ----------
    trace : DataArray
        Over time, with the coordinate `frame`, as `slow_time` or `range_traces` returns it.
    """
    if "frame" not in trace.coords or trace.coords["frame"].dims != ("time",):
        raise InvalidSetting(
            "trace",
            value=f"an array over {', '.join(map(str, trace.dims)) or 'no axis'}",
            expected="an array over time, with the coordinate frame",
            fix="pass what slow_time or range_traces returns",
        )
    if trace.sizes["time"] == 0:
        return trace
    mean = trace.groupby("frame").mean()
    times_s = trace.coords["time"].groupby("frame").mean()
    means = mean.assign_coords(time=("frame", times_s.values, trace.coords["time"].attrs))
    return means.swap_dims(frame="time").assign_attrs(trace.attrs).transpose("time", ...)


@check_argument_types
def displacement(trace: xr.DataArray, radar: Radar) -> xr.DataArray:
    """Compute the displacement of the target of a trace since its first value.

    Parameters
    ----------
    trace : DataArray (time, ...), complex
        From `slow_time` or `frame_means`.
    radar : Radar

    Returns
    -------
    DataArray (time, ...), m
        lambda / (4 pi) times the phase, unwrapped over time; positive away from the radar. Across
        values of 0, as of lost chirps, a straight line.

    Raises
    ------
    InvalidSetting
        If the trace is not complex over time.

    Warns
    -----
    PhysicsWarning
        If more than 1 % of the steps between values are near half a cycle: movements of a
        quarter of a wavelength or more, or noise, cause wrong cycles. If values are 0, which
        have no phase.
    """
    if "time" not in trace.dims or not np.iscomplexobj(trace):
        raise InvalidSetting(
            "trace",
            value=_describe_array(trace),
            expected="a complex trace over time",
            fix="pass what slow_time or frame_means returns",
        )
    time_axis = trace.get_axis_num("time")
    unwrapped = _unwrap_phase(trace.values, time_axis)
    _warn_about_zero_values(int((trace.values == 0).sum()), trace.size)
    steps = abs(np.diff(unwrapped, axis=time_axis))
    wavelength_m = SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz
    share = np.mean(steps > _MAX_PHASE_STEP) if steps.size else 0.0
    if share > 0.01:
        warnings.warn(
            PhysicsWarning(
                Finding(
                    level="warning",
                    setting="trace",
                    value=f"phase steps above 3/8 of a cycle in {share:.0%} of the values",
                    expected=f"movements well below {wavelength_m / 4 * 1e3:.3g} mm between values,"
                    " of an echo well above the noise",
                    fix="choose a range with a stronger echo, or values closer in time: chirps"
                    " instead of means over frames",
                )
            ),
            stacklevel=2,
        )
    moved_m = wavelength_m / (4 * np.pi) * (unwrapped - np.take(unwrapped, [0], axis=time_axis))
    return trace.copy(data=moved_m).assign_attrs(units="m", long_name="displacement")


def _unwrap_phase(values: np.ndarray, axis: int) -> np.ndarray:
    """Unwrap the phase along an axis, with a straight line across values of 0."""
    # Double precision: single precision loses micrometres over the cycles of a metre.
    phase = np.moveaxis(np.angle(values.astype(np.complex128)), axis, -1)
    is_valid = np.moveaxis(values != 0, axis, -1)
    for trace in np.ndindex(phase.shape[:-1]):
        valid_index = np.flatnonzero(is_valid[trace])
        if valid_index.size:
            index = np.arange(phase.shape[-1])
            phase[trace] = np.interp(index, valid_index, np.unwrap(phase[trace][valid_index]))
    return np.moveaxis(phase, -1, axis)


def _warn_about_zero_values(n_zeros: int, n_values: int) -> None:
    if n_zeros:
        finding = Finding(
            level="warning",
            setting="trace",
            value=f"0 in {n_zeros} of {n_values} values, which have no phase",
            expected="an echo in every chirp",
            fix="use a part of the recording without gaps for small movements; a straight line"
            " replaces lost chirps",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


@check_argument_types
def displacement_spectrum(displacement: xr.DataArray, *, window: Window = "hann") -> xr.DataArray:
    """Compute the amplitude spectrum of a displacement.

    Parameters
    ----------
    displacement : DataArray (time, ...), m
        From `displacement`, at steps of time that are equal or vary as the time stamps of a
        computer do; a straight line is subtracted.
    window : Window
        Over time.

    Returns
    -------
    DataArray (frequency, ...), m
        A sine on a bin has its amplitude there. `frequency` (Hz) from 0 to half the rate.

    Raises
    ------
    InvalidSetting
        If a time is more than a step from its place in equal steps, there are fewer than
        four times, or the displacement is not real.

    Notes
    -----
    Uneven times are replaced by even ones, by cubic splines. An oscillation of 1/8 of the rate
    then keeps its amplitude within 1 %.
    """
    if "time" not in displacement.dims or np.iscomplexobj(displacement):
        raise InvalidSetting(
            "displacement",
            value=_describe_array(displacement),
            expected="a real displacement over time",
            fix="pass what displacement returns",
        )
    times_s = displacement.coords["time"].values
    steps_s = np.diff(times_s)
    even_times_s = np.linspace(times_s[0], times_s[-1], len(times_s)) if len(times_s) else times_s
    if (
        len(times_s) < 4
        or not (steps_s > 0).all()
        or (abs(times_s - even_times_s) > np.mean(steps_s)).any()
    ):
        raise InvalidSetting(
            "displacement",
            value=f"{len(times_s)} times"
            + (
                f", {format_si(steps_s.min(), 's', 3)} to {format_si(steps_s.max(), 's', 3)} apart"
                if len(steps_s)
                else ""
            ),
            expected="four or more at nearly equal steps",
            fix="take one value of each frame with frame_means, or the chirps of one frame",
        )
    values = displacement.transpose("time", ...).values
    line = np.stack([np.ones_like(times_s), even_times_s - even_times_s.mean()], axis=1)
    flat = values.reshape(len(times_s), -1)
    if np.ptp(steps_s) > 1e-2 * np.mean(steps_s):
        flat = scipy.interpolate.CubicSpline(times_s, flat)(even_times_s)
    flat = flat - line @ np.linalg.lstsq(line, flat, rcond=None)[0]
    weights = Transform(window=window, n_points=len(flat), n_bins=len(flat)).weights
    amplitude = 2 * abs(np.fft.rfft(flat * weights[:, None], axis=0)) / weights.sum()
    frequencies_hz = np.fft.rfftfreq(len(flat), steps_s.mean())
    others = [name for name in displacement.dims if name != "time"]
    return xr.DataArray(
        amplitude.reshape(len(frequencies_hz), *values.shape[1:]),
        dims=("frequency", *others),
        coords={
            "frequency": ("frequency", frequencies_hz, {"units": "Hz"}),
            **{name: displacement.coords[name] for name in others if name in displacement.coords},
        },
        attrs={
            "units": "m",
            "long_name": "displacement amplitude",
            "window": window,
            "n_times": len(flat),
        },
    )


@check_argument_types
def strongest_oscillation(spectrum: xr.DataArray, frequency_hz: tuple[float, float]) -> xr.Dataset:
    """Find the strongest periodic movement between two frequencies.

    Parameters
    ----------
    spectrum : DataArray (frequency, ...), m
        From `displacement_spectrum`.
    frequency_hz : (float, float)
        Lowest and highest.

    Returns
    -------
    Dataset over the other axes of the spectrum
        `frequency` (Hz) and `amplitude` (m) of the highest local maximum, interpolated between
        bins with the window; NaN without one; `floor` (m): the median over the interval, 0.83 of
        the root mean square of the noise.

    Raises
    ------
    InvalidSetting
        If the interval contains fewer than three bins, or the spectrum lacks its attributes.
    """
    if not {"window", "n_times"} <= set(spectrum.attrs):
        raise InvalidSetting(
            "spectrum",
            value=_describe_array(spectrum) + " without the attributes window and n_times",
            expected="a spectrum with its attributes",
            fix="give what displacement_spectrum returns; after sums of it, with its attributes:"
            " mean('channel', keep_attrs=True)",
        )
    bins_hz = spectrum.coords["frequency"].values
    step_hz = (bins_hz[-1] - bins_hz[0]) / max(len(bins_hz) - 1, 1)
    ends_hz = check_finite_array("frequency_hz", frequency_hz)
    rows = np.array([], dtype=int)
    if ends_hz.shape == (2,):
        rows = np.flatnonzero((ends_hz[0] <= bins_hz) & (bins_hz <= ends_hz[1]))
    if rows.size < 3:
        raise InvalidSetting(
            "frequency_hz",
            value=frequency_hz,
            expected=f"an interval with three bins or more, {format_si(step_hz, 'hz', 3)} apart"
            f" up to {format_si(bins_hz[-1], 'hz', 4)}",
            fix="give the lowest frequency, then the highest; record longer for finer bins",
        )
    n_points = spectrum.attrs["n_times"]
    transform = Transform(window=spectrum.attrs["window"], n_points=n_points, n_bins=n_points)
    values = spectrum.transpose("frequency", ...).values
    # Excludes the flank of a line beyond an end of the interval.
    neighbour = np.maximum(
        values[np.maximum(rows - 1, 0)], values[np.minimum(rows + 1, len(values) - 1)]
    )
    is_top = values[rows] >= neighbour
    top = rows[0] + np.argmax(np.where(is_top, values[rows], -1.0), axis=0)
    inner = np.clip(top, 1, len(bins_hz) - 2)
    lower, centre, upper = (
        np.take_along_axis(values, (inner + neighbour)[None], axis=0)[0] for neighbour in (-1, 0, 1)
    )
    off = tone_bin_offsets(lower**2, centre**2, upper**2, transform)
    straddle_amplitude = np.sqrt(
        np.vectorize(lambda bins: transform.straddling_loss(bins / n_points))(off)
    )
    is_any = is_top.any(axis=0)
    others = [name for name in spectrum.dims if name != "frequency"]
    columns = {
        "frequency": (np.where(is_any, bins_hz[0] + (inner + off) * step_hz, np.nan), "Hz"),
        "amplitude": (np.where(is_any, centre / straddle_amplitude, np.nan), "m"),
        "floor": (np.median(values[rows], axis=0), "m"),
    }
    return xr.Dataset(
        {name: (others, value, {"units": units}) for name, (value, units) in columns.items()},
        coords={name: spectrum.coords[name] for name in others if name in spectrum.coords},
    )


def _describe_array(array: xr.DataArray) -> str:
    return f"an array of {dict(array.sizes)} and type {array.dtype}"


def _rows_of_interval(
    range_m: tuple[float, float], bins_m: np.ndarray, *, at_least: int, interval: str
) -> np.ndarray:
    """Return the rows within an interval, or raise `InvalidSetting` if it has too few."""
    ends_m = check_finite_array("range_m", range_m)
    rows = np.array([], dtype=int)
    if ends_m.shape == (2,):
        rows = np.flatnonzero((ends_m[0] <= bins_m) & (bins_m <= ends_m[1]))
    if rows.size < at_least:
        raise InvalidSetting(
            "range_m",
            value=range_m,
            expected=f"{interval}, from 0 to {bins_m[-1]:.4g} m",
            fix="give the nearest range, then the farthest",
        )
    return rows


def _round_times_and_frames(
    cube: xr.DataArray, radar: Radar
) -> dict[str, xr.Variable | xr.DataArray]:
    """Return the coordinates time and frame of each round of each frame."""
    frame = radar.frame
    of_round_s = np.arange(frame.n_chirps) * frame.repetition_s
    middle_s = float(frame.slot_starts_s.mean()) + frame.chirp.mid_window_s
    starts_s = frame_starts_s(cube, radar)
    of_frame = np.repeat(np.arange(len(starts_s)), frame.n_chirps)
    times_s = (starts_s[:, None] + of_round_s + middle_s).ravel()
    return {
        "time": xr.Variable("time", times_s, {"units": "s", "long_name": "time"}),
        "frame": xr.Variable("time", of_frame),
    }
