"""The chain in whole numbers, from the samples of a frame to the cells over threshold."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.conventions import axis
from dechirp.core.memory import must_fit
from dechirp.process.chain import Chain
from dechirp.process.fixed_point.cfar import thresholds
from dechirp.process.fixed_point.fft import fft
from dechirp.process.fixed_point.power import log2_words, powers
from dechirp.process.fixed_point.rounding import MODES
from dechirp.process.fixed_point.samples import whole_samples
from dechirp.process.fixed_point.tables import Tables, tables
from dechirp.process.fixed_point.window import weighted
from dechirp.process.fixed_point.words import WordLengths
from dechirp.process.virtual import channels
from dechirp.radar.radar import Radar

_Axes = tuple[str, ...]


class Block(NamedTuple):
    """What one block of the machine hands on to the next."""

    name: str
    integers: np.ndarray
    axes: _Axes
    """Of the integers; the last one is `iq` where they are parts of complex numbers."""
    bits: int
    """Of each word: what the integers need, and no more."""
    is_signed: bool = True
    overflows: np.ndarray = np.zeros(0, np.int64)
    """Words saturated in it, stage by stage."""


def fixed_point_map(
    cube: xr.DataArray, radar: Radar, chain: Chain | None = None, words: WordLengths | None = None
) -> xr.Dataset:
    """Range-Doppler map, logarithm and detector of one frame in whole numbers, bit by bit.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample), or (chirp, rx, sample, iq)
        One frame; whole numbers, as `codes` gives, or samples, see `whole_samples`.
    radar : Radar
        The waveform and the receivers that the cube was taken with.
    chain : Chain, optional
        Windows, bins and detector, as of `detect`; transforms must be powers of two long.
    words : WordLengths, optional
        16 bits in both transforms without it.

    Returns
    -------
    Dataset
        power : (velocity, range) int64
            Channels summed; times its attribute `scale` it is that of `power_map`.
        log_power : (velocity, range) uint16
            Logarithm to base 2 of `power`, attribute `fraction_bits` of it behind the point.
        threshold : (velocity, range) int64
            As `power`; the largest word where it would be larger, and in rows not searched.
        detected : (velocity, range) bool
            Whether the power exceeds the threshold.
        range_exponent : (chirp, channel) int64
            Bits by which block scaling shifted the range profile of a chirp to the right.
        doppler_exponent : (channel, range) int64
            The same of the Doppler spectrum of a row.
        overflows : (stage,) int64
            Words saturated; `stage` is the name of the block and the number of the stage.

    Raises
    ------
    InvalidSetting
        If a transform is no power of two long, the cube is not one frame of that radar, or the
        chain has what there is not in whole numbers.
    NotEnoughMemory
        If the words would not fit.
    """
    plan = tables(radar, (chain or Chain()).fitted(radar), words or WordLengths())
    samples, step = whole_samples(cube, radar, plan.words)
    made = {
        block.name: block if block.name in _KEPT else block._replace(integers=np.zeros(0))
        for block in blocks(samples, radar, plan)
    }
    range_exponent = made["range_shifts"].integers.sum(axis=-1)
    doppler_exponent = made["doppler_shifts"].integers.sum(axis=-1)
    exponent = int(range_exponent.max() + doppler_exponent.max())
    units = "W" if cube.attrs.get("units") == "sqrt(W)" else "full scale squared"
    scale = {"scale": _scale(plan, step, exponent, radar), "units": units}
    fraction = {"fraction_bits": plan.words.log_fraction_bits}
    attributes = {"power": scale, "log_power": fraction, "threshold": scale}
    counts = [(block.name, block.overflows) for block in made.values()]
    frame = radar.frame
    return xr.Dataset(
        {
            **{
                name: (made[name].axes, made[name].integers, attributes.get(name, {}))
                for name in ("power", "log_power", "threshold", "detected")
            },
            "range_exponent": (("chirp", "channel"), range_exponent),
            "doppler_exponent": (("channel", "range"), doppler_exponent),
            "overflows": ("stage", np.concatenate([each for _, each in counts])),
        },
        coords={
            "velocity": axis("velocity", frame.velocity_bins_m_per_s(plan.over_velocity.n_bins)),
            "range": axis("range", frame.chirp.range_bins_m(plan.over_range.n_bins)),
            "stage": [f"{name} {at}" for name, each in counts for at in range(len(each))],
        },
    )


_KEPT = {"range_shifts", "doppler_shifts", "power", "log_power", "threshold", "detected"}


def blocks(samples: np.ndarray, radar: Radar, plan: Tables) -> Iterator[Block]:
    """What each block hands on, in the order of the signal.

    `samples` (chirp, rx, sample, 2) are those of `whole_samples`, `plan` of `tables`. One block
    is made at a time, when it is asked for.
    """
    words = plan.words
    mode = MODES[words.rounding]
    n_chirps, n_channels = plan.over_velocity.n_points, plan.n_channels
    n_rounds, n_samples = len(samples), samples.shape[2]
    must_fit(
        "words of one frame",
        needed_bytes=n_chirps * n_channels * plan.over_range.n_bins * 24.0,
        fix="Take fewer range bins, or fewer channels.",
    )
    parted = channels(samples.reshape(n_rounds, -1, 2 * n_samples), radar.frame)
    points = parted.reshape(n_chirps, n_channels, n_samples, 2)
    is_complex = radar.frame.chirp.sampling == "complex"
    yield (
        Block("samples", points, ("chirp", "channel", "sample", "iq"), words.sample_bits)
        if is_complex
        else Block("samples", points[..., 0], ("chirp", "channel", "sample"), words.sample_bits)
    )

    shifts = np.broadcast_to(np.int64(plan.range_shift), points.shape[:3])
    tapered, n_overflows = weighted(
        points, plan.range_window, shifts, plan.over_range.n_bins, words.range_bits, mode
    )
    axes: _Axes = ("chirp", "channel", "sample", "iq")
    yield Block("range_window", tapered, axes, words.range_bits, overflows=np.array([n_overflows]))

    transformed = fft(tapered, words.range_bits, words)
    del tapered
    profiles = transformed.points[:, :, : plan.n_rows]
    exponents = transformed.shifts.sum(axis=-1)
    axes = ("chirp", "channel", "range", "iq")
    yield Block("range_fft", profiles, axes, words.range_bits, overflows=transformed.overflows)
    yield _shifts("range_shifts", transformed.shifts, ("chirp", "channel", "stage"))

    # The corner turn: all chirps and channels come to the largest exponent there is.
    below = (plan.doppler_shift + exponents.max() - exponents).T[:, None, :]
    shifts = np.broadcast_to(below, (n_channels, plan.n_rows, n_chirps))
    tapered, n_overflows = weighted(
        profiles.transpose(1, 2, 0, 3),
        plan.doppler_window,
        shifts,
        plan.over_velocity.n_bins,
        words.doppler_bits,
        mode,
    )
    del profiles, transformed
    axes = ("channel", "range", "chirp", "iq")
    yield Block(
        "doppler_window", tapered, axes, words.doppler_bits, overflows=np.array([n_overflows])
    )

    transformed = fft(tapered, words.doppler_bits, words)
    del tapered
    exponents = transformed.shifts.sum(axis=-1)
    axes = ("channel", "range", "velocity", "iq")
    yield Block(
        "doppler_fft",
        transformed.points,
        axes,
        words.doppler_bits,
        overflows=transformed.overflows,
    )
    yield _shifts("doppler_shifts", transformed.shifts, ("channel", "range", "stage"))

    down = 2 * (exponents.max() - exponents) - plan.power_shift
    power = powers(transformed.points, down, mode)
    del transformed
    axes = ("velocity", "range")
    yield Block("power", power, axes, words.power_bits, is_signed=False)

    logarithm = log2_words(power, plan.logarithms, words.log_table_bits, words.log_fraction_bits)
    yield Block("log_power", logarithm, axes, words.log_bits, is_signed=False)

    threshold = _threshold(power, plan)
    yield Block("threshold", threshold, axes, words.power_bits, is_signed=False)
    yield Block("detected", power > threshold, axes, 1, is_signed=False)


def _shifts(name: str, shifts: np.ndarray, axes: _Axes) -> Block:
    return Block(name, shifts, axes, 2, is_signed=False)


def _threshold(power: np.ndarray, plan: Tables) -> np.ndarray:
    """Threshold of each cell, the largest word where none can exceed it."""
    most = 2**plan.words.power_bits - 1
    out = np.full(power.shape, most, np.int64)
    searched = power[:, plan.searched]
    n_rows = searched.shape[1]
    starts = np.arange(n_rows) - plan.ring.places(n_rows)
    found = thresholds(searched, plan.factors, plan.factor_shift, starts, plan.ring.sizes)
    out[:, plan.searched] = np.minimum(found, most)
    return out


def _scale(plan: Tables, step: float, exponent: int, radar: Radar) -> float:
    """Power of one unit of the map, for samples of `step`, so that a tone keeps its power."""
    words = plan.words
    one = 2.0 ** (words.window_bits - 2)
    gain = plan.range_window.sum() / one * abs(plan.doppler_window).sum() / one
    below_point = words.doppler_bits - words.sample_bits - exponent
    amplitude = step / gain * 2.0**-below_point
    # A real tone puts half its power at negative frequencies, which are not kept.
    sides = 1 if radar.frame.chirp.sampling == "complex" else 2
    return float(sides * amplitude**2 / plan.n_channels * 2.0**-plan.power_shift)
