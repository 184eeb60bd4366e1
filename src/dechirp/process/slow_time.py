r"""Slow time: the phase of one range cell from chirp to chirp, and the movement that it tells.

A target at R turns the beat by

.. math:: \varphi = \frac{4\pi f R}{c}

at the middle of the sampling window, f the frequency sent there: half a wavelength is a turn,
2 mm at 77 GHz. So the phase tells movements of micrometres, where range cells are centimetres
wide, up to whole turns: from one value to the next no target may move more than a quarter of a
wavelength.

White noise leaves displacements a standard deviation of lambda / (4 pi sqrt(2 S)), S the ratio
of the echo to the noise in the cell. What stands still in the same cell adds a constant to the
trace and draws the phase towards its own: displacements come out too small, or bent.

References
----------
C. Li, V. M. Lubecke, O. Boric-Lubecke and J. Lin, A review on recent advances in Doppler radar
sensors for noncontact healthcare monitoring, IEEE Trans. MTT 61(5), 2013.
"""

import warnings

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.checks import numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.process.interpolation import offsets
from dechirp.process.spectrogram import frame_starts_s, must_be_finite, must_be_of
from dechirp.process.spectrum import Transform, amplitude_weights, range_profiles
from dechirp.process.virtual import channels
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window

# Steps of phase between values of a trace beyond this may as well be a turn less: noise of 15 dB
# (0.13 rad) leaves three quarters of a half turn six of its standard deviations of room.
_SURE_STEP = 0.75 * np.pi
_FINE = 8  # range bins a resolution cell: peaks lose 0.06 dB between them


def slow_time(
    cube: xr.DataArray, radar: Radar, range_m: ArrayLike, *, window: Window = "hann"
) -> xr.DataArray:
    """What comes from one range, chirp by chirp: the trace that its phase is read from.

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
        Over the samples: what keeps other ranges out.

    Returns
    -------
    DataArray (time, channel), complex
        A steady echo has the magnitude of its amplitude. `time` (s): mid-window of the middle
        slot of each round; `frame`, on the same axis, which frame it is of; `channel` is
        slot * n_rx + rx, see `process.virtual.channels`.

    Raises
    ------
    InvalidSetting
        If a range is not within those of the rows, the cube is not that radar's, or some of its
        samples are not finite.
    """
    must_be_of(cube, radar)
    frame, chirp = radar.frame, radar.frame.chirp
    n_rounds = cube.sizes["frame"] * frame.n_chirps
    at_m = numbers("range_m", range_m)
    farthest_m = float(chirp.range_bins_m(chirp.n_samples)[-1])
    if at_m.shape not in {(), (n_rounds,)} or not ((at_m >= 0) & (at_m <= farthest_m)).all():
        raise InvalidSetting(
            "range_m",
            got=range_m if at_m.ndim == 0 else f"an array of shape {at_m.shape}",
            need=f"one number, or {n_rounds}, one for each round, from 0 to {farthest_m:.4g} m",
            fix="Give the range of a target, or what range_track returns.",
        )
    transform = Transform(window=window, n_points=chirp.n_samples, n_bins=chirp.n_samples)
    weights = amplitude_weights(transform, chirp.sampling)
    cycles = chirp.beat_frequency_hz(1.0) / chirp.sample_rate_hz * np.broadcast_to(at_m, n_rounds)
    from_middle = np.arange(chirp.n_samples) - (chirp.n_samples - 1) / 2
    traces = []
    for index, of_rounds in enumerate(cycles.reshape(-1, frame.n_chirps)):
        one = cube.isel(frame=index).transpose("chirp", "rx", "sample").values
        still = np.exp(-2j * np.pi * of_rounds[:, None] * from_middle) * weights
        traces.append(np.einsum("mkn,mn->mk", channels(one, frame), still.astype(np.complex64)))
        must_be_finite(traces[-1])
    units = cube.attrs.get("units", "full scale")
    return xr.DataArray(
        np.concatenate(traces).astype(np.complex64),
        dims=("time", "channel"),
        coords=_of_rounds(cube, radar),
        attrs={"units": units, "long_name": "amplitude"},
    )


def range_track(
    cube: xr.DataArray, radar: Radar, range_m: tuple[float, float], *, window: Window = "hann"
) -> xr.DataArray:
    """Range of the strongest echo within an interval, round by round.

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
        between rows. A target that moves at v is seen v f / S too far, as in any one chirp.

    Raises
    ------
    InvalidSetting
        If the interval holds fewer than three points, the cube is not that radar's, or some of
        its samples are not finite.
    """
    must_be_of(cube, radar)
    frame, chirp = radar.frame, radar.frame.chirp
    transform = Transform(window=window, n_points=chirp.n_samples, n_bins=_FINE * chirp.n_samples)
    bins_m = chirp.range_bins_m(transform.n_bins)
    ends_m = numbers("range_m", range_m)
    rows = np.array([], dtype=int)
    if ends_m.shape == (2,):
        rows = np.flatnonzero((ends_m[0] <= bins_m) & (bins_m <= ends_m[1]))
    if rows.size < 3:
        raise InvalidSetting(
            "range_m",
            got=range_m,
            need=f"an interval of {2 * bins_m[1]:.3g} m or more, from 0 to {bins_m[-1]:.4g} m",
            fix="Give the nearest range, then the farthest.",
        )
    tracks = []
    for index in range(cube.sizes["frame"]):
        one = cube.isel(frame=index).transpose("chirp", "rx", "sample")
        profiles = channels(range_profiles(one, chirp, transform).values[..., rows], frame)
        power = (abs(profiles) ** 2).mean(axis=1)
        must_be_finite(power)
        top = np.clip(np.argmax(power, axis=1), 1, rows.size - 2)
        round_ = np.arange(len(power))
        before, at, after = (power[round_, top + beside] for beside in (-1, 0, 1))
        tracks.append(bins_m[1] * (rows[top] + offsets(before, at, after, transform)))
    return xr.DataArray(
        np.concatenate(tracks),
        dims=("time",),
        coords=_of_rounds(cube, radar),
        attrs={"units": "m", "long_name": "range"},
    )


def by_frame(trace: xr.DataArray) -> xr.DataArray:
    """Mean of a trace over the rounds of each frame, (time, channel): a value a frame.

    Where frames are short bursts of chirps: times are then as far apart as frames, and the
    noise falls by the number of rounds. A target must move far less than a wavelength within a
    frame.
    """
    if trace.sizes["time"] == 0:
        return trace
    mean = trace.groupby("frame").mean()
    times_s = trace.coords["time"].groupby("frame").mean()
    found = mean.assign_coords(time=("frame", times_s.values, trace.coords["time"].attrs))
    return found.swap_dims(frame="time").assign_attrs(trace.attrs).transpose("time", ...)


def displacement(trace: xr.DataArray, radar: Radar) -> xr.DataArray:
    """How far the target of a trace has moved since its first value.

    Parameters
    ----------
    trace : DataArray (time, ...), complex
        As `slow_time` and `by_frame` return it.
    radar : Radar

    Returns
    -------
    DataArray (time, ...), m
        lambda / (4 pi) times the phase, unwrapped over time; away from the radar positive. Across
        values of 0, as lost chirps leave them, a straight line.

    Raises
    ------
    InvalidSetting
        If the trace is not complex over time.

    Warns
    -----
    PhysicsWarning
        If more than 1 % of the steps from value to value are near half a turn: movements of a
        quarter of a wavelength and more between them, or noise, make turns that are not there.
        If values are 0: they have no phase.
    """
    if "time" not in trace.dims or not np.iscomplexobj(trace):
        raise InvalidSetting(
            "trace",
            got=_kind(trace),
            need="a trace over time, complex: its phase tells the movement",
            fix="Give what slow_time or by_frame returns.",
        )
    places = trace.get_axis_num("time")
    unwrapped = _unwrapped(trace.values, places)
    _say_silent(int((trace.values == 0).sum()), trace.size)
    steps = abs(np.diff(unwrapped, axis=places))
    wavelength_m = SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz
    share = np.mean(steps > _SURE_STEP) if steps.size else 0.0
    if share > 0.01:
        warnings.warn(
            PhysicsWarning(
                Finding(
                    level="warning",
                    setting="trace",
                    got=f"steps of more than three eighths of a turn in {share:.0%} of the values",
                    need=f"movements well under {wavelength_m / 4 * 1e3:.3g} mm from value to"
                    " value, of an echo well over the noise",
                    fix="Take a range with a stronger echo, or values nearer in time: chirps"
                    " instead of means over frames.",
                )
            ),
            stacklevel=2,
        )
    moved_m = wavelength_m / (4 * np.pi) * (unwrapped - np.take(unwrapped, [0], axis=places))
    return trace.copy(data=moved_m).assign_attrs(units="m", long_name="displacement")


def _unwrapped(values: np.ndarray, axis: int) -> np.ndarray:
    """Phase without turns along an axis, a straight line across values of 0."""
    # Double precision: single loses micrometres over the turns of a metre.
    phase = np.moveaxis(np.angle(values.astype(np.complex128)), axis, -1)
    told = np.moveaxis(values != 0, axis, -1)
    for trace in np.ndindex(phase.shape[:-1]):
        at = np.flatnonzero(told[trace])
        if at.size:
            over = np.arange(phase.shape[-1])
            phase[trace] = np.interp(over, at, np.unwrap(phase[trace][at]))
    return np.moveaxis(phase, -1, axis)


def _say_silent(n_silent: int, n_values: int) -> None:
    if n_silent:
        finding = Finding(
            level="warning",
            setting="trace",
            got=f"0 in {n_silent} of {n_values} values, which have no phase",
            need="an echo in every chirp",
            fix="Where chirps were lost a straight line takes their place; take a part of the"
            " recording without gaps for small movements.",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


def displacement_spectrum(moved: xr.DataArray, *, window: Window = "hann") -> xr.DataArray:
    """Amplitude of a movement over frequency.

    Parameters
    ----------
    moved : DataArray (time, ...), m
        As `displacement` returns it, at equal steps of time; a straight line is taken out.
    window : Window
        Over time.

    Returns
    -------
    DataArray (frequency, ...), m
        A sine on a bin has its amplitude there. `frequency` (Hz) from 0 to half the rate.

    Raises
    ------
    InvalidSetting
        If times are not at equal steps, or fewer than four, or the movement is not real over time.
    """
    if "time" not in moved.dims or np.iscomplexobj(moved):
        raise InvalidSetting(
            "moved",
            got=_kind(moved),
            need="a movement over time, real",
            fix="Give what displacement returns of a trace.",
        )
    times_s = moved.coords["time"].values
    steps_s = np.diff(times_s)
    if len(times_s) < 4 or np.ptp(steps_s) > 1e-2 * np.mean(steps_s):
        raise InvalidSetting(
            "moved",
            got=f"{len(times_s)} times"
            + (f", {steps_s.min():.3g} to {steps_s.max():.3g} s apart" if len(steps_s) else ""),
            need="four or more at equal steps",
            fix="Take one value of each frame with by_frame, or the chirps of one frame.",
        )
    values = moved.transpose("time", ...).values
    line = np.stack([np.ones_like(times_s), times_s - times_s.mean()], axis=1)
    flat = values.reshape(len(times_s), -1)
    flat = flat - line @ np.linalg.lstsq(line, flat, rcond=None)[0]
    weights = Transform(window=window, n_points=len(flat), n_bins=len(flat)).weights
    amplitude = 2 * abs(np.fft.rfft(flat * weights[:, None], axis=0)) / weights.sum()
    frequencies_hz = np.fft.rfftfreq(len(flat), steps_s.mean())
    others = [name for name in moved.dims if name != "time"]
    return xr.DataArray(
        amplitude.reshape(len(frequencies_hz), *values.shape[1:]),
        dims=("frequency", *others),
        coords={
            "frequency": ("frequency", frequencies_hz, {"units": "Hz"}),
            **{name: moved.coords[name] for name in others if name in moved.coords},
        },
        attrs={
            "units": "m",
            "long_name": "displacement amplitude",
            "window": window,
            "n_times": len(flat),
        },
    )


def strongest_line(spectrum: xr.DataArray, frequency_hz: tuple[float, float]) -> xr.Dataset:
    """The strongest periodic movement between two frequencies.

    Parameters
    ----------
    spectrum : DataArray (frequency, ...), m
        As `displacement_spectrum` returns it.
    frequency_hz : (float, float)
        Lowest and highest.

    Returns
    -------
    Dataset over the other axes of the spectrum
        `frequency` (Hz) and `amplitude` (m) of the highest bin that is higher than those beside
        it, interpolated between bins through the window; NaN where there is none;
        `floor` (m): the median over the interval, 0.83 of what noise has in the mean of squares.

    Raises
    ------
    InvalidSetting
        If the interval holds fewer than three bins, or the spectrum has lost its attributes.
    """
    if not {"window", "n_times"} <= set(spectrum.attrs):
        raise InvalidSetting(
            "spectrum",
            got=_kind(spectrum) + " without the attributes window and n_times",
            need="a spectrum with the window that it was taken with",
            fix="Give what displacement_spectrum returns; after sums of it, with its attributes:"
            " mean('channel', keep_attrs=True).",
        )
    bins_hz = spectrum.coords["frequency"].values
    step_hz = (bins_hz[-1] - bins_hz[0]) / max(len(bins_hz) - 1, 1)
    ends_hz = numbers("frequency_hz", frequency_hz)
    rows = np.array([], dtype=int)
    if ends_hz.shape == (2,):
        rows = np.flatnonzero((ends_hz[0] <= bins_hz) & (bins_hz <= ends_hz[1]))
    if rows.size < 3:
        raise InvalidSetting(
            "frequency_hz",
            got=frequency_hz,
            need=f"an interval that holds three bins, {step_hz:.3g} Hz apart up to"
            f" {bins_hz[-1]:.4g} Hz",
            fix="Give the lowest frequency, then the highest; record longer for finer bins.",
        )
    n_points = spectrum.attrs["n_times"]
    transform = Transform(window=spectrum.attrs["window"], n_points=n_points, n_bins=n_points)
    values = spectrum.transpose("frequency", ...).values
    # Not the flank of a line beyond an end of the interval.
    beside = np.maximum(
        values[np.maximum(rows - 1, 0)], values[np.minimum(rows + 1, len(values) - 1)]
    )
    is_top = values[rows] >= beside
    top = rows[0] + np.argmax(np.where(is_top, values[rows], -1.0), axis=0)
    inner = np.clip(top, 1, len(bins_hz) - 2)
    before, at, after = (
        np.take_along_axis(values, (inner + beside)[None], axis=0)[0] for beside in (-1, 0, 1)
    )
    off = offsets(before**2, at**2, after**2, transform)
    kept = np.sqrt(np.vectorize(lambda bins: transform.straddle(bins / n_points))(off))
    is_any = is_top.any(axis=0)
    others = [name for name in spectrum.dims if name != "frequency"]
    found = {
        "frequency": (np.where(is_any, bins_hz[0] + (inner + off) * step_hz, np.nan), "Hz"),
        "amplitude": (np.where(is_any, at / kept, np.nan), "m"),
        "floor": (np.median(values[rows], axis=0), "m"),
    }
    return xr.Dataset(
        {name: (others, value, {"units": units}) for name, (value, units) in found.items()},
        coords={name: spectrum.coords[name] for name in others if name in spectrum.coords},
    )


def _kind(array: xr.DataArray) -> str:
    return f"of {dict(array.sizes)} and the type {array.dtype}"


def _of_rounds(cube: xr.DataArray, radar: Radar) -> dict[str, xr.Variable | xr.DataArray]:
    """Time and frame of each round of each frame."""
    frame = radar.frame
    of_round_s = np.arange(frame.n_chirps) * frame.repetition_s
    middle_s = float(frame.slots_s.mean()) + frame.chirp.mid_window_s
    starts_s = frame_starts_s(cube, radar)
    of_frame = np.repeat(np.arange(len(starts_s)), frame.n_chirps)
    times_s = (starts_s[:, None] + of_round_s + middle_s).ravel()
    return {
        "time": xr.Variable("time", times_s, {"units": "s", "long_name": "time"}),
        "frame": xr.Variable("time", of_frame),
    }
