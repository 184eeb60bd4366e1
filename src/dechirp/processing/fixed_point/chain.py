"""Fixed-point chain, from the samples of a frame to the cells over threshold."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.conventions import axis_coordinate
from dechirp.core.memory import check_free_memory
from dechirp.core.units import power_units
from dechirp.processing.chain import Chain
from dechirp.processing.fixed_point.cfar import cell_averaging_thresholds
from dechirp.processing.fixed_point.fft import fft
from dechirp.processing.fixed_point.lookup_tables import LookupTables, make_lookup_tables
from dechirp.processing.fixed_point.samples import to_integer_samples_and_step
from dechirp.processing.fixed_point.word_lengths import (
    ROUNDING_CODES,
    WordLengths,
    saturate,
    shift_right_rounded,
)
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.radar import Radar

__all__ = ["fixed_point_map"]

_Axes = tuple[str, ...]


class StageOutput(NamedTuple):
    """Output of one stage of the chain."""

    name: str
    integers: np.ndarray
    axes: _Axes
    """Axes of the integers; the last one is `iq` for parts of complex values."""
    bits: int
    """Bits that each word needs."""
    is_signed: bool = True
    overflows: np.ndarray = np.zeros(0, np.int64)
    """Number of saturated words in each stage."""


@check_argument_types
def fixed_point_map(
    cube: xr.DataArray, radar: Radar, chain: Chain | None = None, words: WordLengths | None = None
) -> xr.Dataset:
    """Compute range-Doppler map, logarithm and detector of one frame, bit-accurately in integers.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample), or (chirp, rx, sample, iq)
        One frame; integers, as from `codes`, or samples, see `to_integer_samples_and_step`.
    radar : Radar
        Waveform and receivers of the cube.
    chain : Chain, optional
        Windows, bins and detector, as in `detect`; transform lengths must be powers of two.
    words : WordLengths, optional
        16 bits in both transforms by default.

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
            True if the power exceeds the threshold.
        range_exponent : (chirp, channel) int64
            Bits by which block scaling shifted the range profile of a chirp to the right.
        doppler_exponent : (channel, range) int64
            Bits by which block scaling shifted the Doppler spectrum of a row.
        overflows : (stage,) int64
            Words saturated; `stage` is the name of the block and the number of the stage.

    Raises
    ------
    InvalidSetting
        If a transform length is no power of two, the cube is not one frame of that radar, or the
        chain has steps without a fixed-point version.
    NotEnoughMemory
        If the words do not fit into memory.
    """
    plan = make_lookup_tables(radar, (chain or Chain()).fit_to_radar(radar), words or WordLengths())
    samples, step = to_integer_samples_and_step(cube, radar, plan.words)
    outputs = {
        block.name: block
        if block.name in _RETURNED_OUTPUTS
        else block._replace(integers=np.zeros(0))
        for block in stage_outputs(samples, radar, plan)
    }
    range_exponent = outputs["range_shifts"].integers.sum(axis=-1)
    doppler_exponent = outputs["doppler_shifts"].integers.sum(axis=-1)
    exponent = int(range_exponent.max() + doppler_exponent.max())
    units = power_units(cube.attrs.get("units"))
    scale = {"scale": _power_per_map_unit(plan, step, exponent, radar), "units": units}
    fraction = {"fraction_bits": plan.words.log_fraction_bits}
    attributes = {"power": scale, "log_power": fraction, "threshold": scale}
    counts = [(block.name, block.overflows) for block in outputs.values()]
    frame = radar.frame
    return xr.Dataset(
        {
            **{
                name: (outputs[name].axes, outputs[name].integers, attributes.get(name, {}))
                for name in ("power", "log_power", "threshold", "detected")
            },
            "range_exponent": (("chirp", "channel"), range_exponent),
            "doppler_exponent": (("channel", "range"), doppler_exponent),
            "overflows": ("stage", np.concatenate([stage_counts for _, stage_counts in counts])),
        },
        coords={
            "velocity": axis_coordinate(
                "velocity", frame.velocity_bins_m_per_s(plan.doppler_transform.n_bins)
            ),
            "range": axis_coordinate(
                "range", frame.chirp.range_bins_m(plan.range_transform.n_bins)
            ),
            "stage": [
                f"{name} {stage}"
                for name, stage_counts in counts
                for stage in range(len(stage_counts))
            ],
        },
    )


_RETURNED_OUTPUTS = {
    "range_shifts",
    "doppler_shifts",
    "power",
    "log_power",
    "threshold",
    "detected",
}


def stage_outputs(samples: np.ndarray, radar: Radar, plan: LookupTables) -> Iterator[StageOutput]:
    """Yield the output of each stage in processing order.

    `samples` (chirp, rx, sample, 2) are those of `to_integer_samples_and_step`, `plan` of
    `make_lookup_tables`. Each output is computed when it is requested.
    """
    words = plan.words
    rounding_code = ROUNDING_CODES[words.rounding]
    n_chirps, n_channels = plan.doppler_transform.n_points, plan.n_channels
    n_rounds, n_samples = len(samples), samples.shape[2]
    check_free_memory(
        "words of one frame",
        needed_bytes=n_chirps * n_channels * plan.range_transform.n_bins * 24.0,
        fix="take fewer range bins, or fewer channels",
    )
    slot_samples = split_chirps_into_slots(
        samples.reshape(n_rounds, -1, 2 * n_samples), radar.frame
    )
    points = slot_samples.reshape(n_chirps, n_channels, n_samples, 2)
    is_complex = radar.frame.chirp.sampling == "complex"
    yield (
        StageOutput("samples", points, ("chirp", "channel", "sample", "iq"), words.sample_bits)
        if is_complex
        else StageOutput(
            "samples", points[..., 0], ("chirp", "channel", "sample"), words.sample_bits
        )
    )

    shifts = np.broadcast_to(np.int64(plan.range_product_right_shift), points.shape[:3])
    tapered, n_overflows = apply_window_and_pad(
        points,
        plan.range_window,
        shifts,
        plan.range_transform.n_bins,
        words.range_bits,
        rounding_code,
    )
    axes: _Axes = ("chirp", "channel", "sample", "iq")
    yield StageOutput(
        "range_window", tapered, axes, words.range_bits, overflows=np.array([n_overflows])
    )

    transformed = fft(tapered, words.range_bits, words)
    del tapered
    profiles = transformed.points[:, :, : plan.n_rows]
    exponents = transformed.shifts.sum(axis=-1)
    axes = ("chirp", "channel", "range", "iq")
    yield StageOutput(
        "range_fft", profiles, axes, words.range_bits, overflows=transformed.overflows
    )
    yield _stage_output_of_shifts("range_shifts", transformed.shifts, ("chirp", "channel", "stage"))

    # Corner turn: all chirps and channels are aligned to the largest exponent.
    doppler_shifts = (plan.doppler_product_right_shift + exponents.max() - exponents).T[:, None, :]
    shifts = np.broadcast_to(doppler_shifts, (n_channels, plan.n_rows, n_chirps))
    tapered, n_overflows = apply_window_and_pad(
        profiles.transpose(1, 2, 0, 3),
        plan.doppler_window,
        shifts,
        plan.doppler_transform.n_bins,
        words.doppler_bits,
        rounding_code,
    )
    del profiles, transformed
    axes = ("channel", "range", "chirp", "iq")
    yield StageOutput(
        "doppler_window", tapered, axes, words.doppler_bits, overflows=np.array([n_overflows])
    )

    transformed = fft(tapered, words.doppler_bits, words)
    del tapered
    exponents = transformed.shifts.sum(axis=-1)
    axes = ("channel", "range", "velocity", "iq")
    yield StageOutput(
        "doppler_fft",
        transformed.points,
        axes,
        words.doppler_bits,
        overflows=transformed.overflows,
    )
    yield _stage_output_of_shifts(
        "doppler_shifts", transformed.shifts, ("channel", "range", "stage")
    )

    power_shifts = 2 * (exponents.max() - exponents) - plan.power_left_shift
    power = sum_channel_powers(transformed.points, power_shifts, rounding_code)
    del transformed
    axes = ("velocity", "range")
    yield StageOutput("power", power, axes, words.power_bits, is_signed=False)

    logarithm = log2_of_powers(
        power, plan.logarithms, words.log_table_bits, words.log_fraction_bits
    )
    yield StageOutput("log_power", logarithm, axes, words.log_bits, is_signed=False)

    threshold = _threshold_map(power, plan)
    yield StageOutput("threshold", threshold, axes, words.power_bits, is_signed=False)
    yield StageOutput("detected", power > threshold, axes, 1, is_signed=False)


def _stage_output_of_shifts(name: str, shifts: np.ndarray, axes: _Axes) -> StageOutput:
    return StageOutput(name, shifts, axes, 2, is_signed=False)


def _threshold_map(power: np.ndarray, plan: LookupTables) -> np.ndarray:
    """Return the threshold of each cell, the largest word where none can exceed it."""
    largest_word = 2**plan.words.power_bits - 1
    out = np.full(power.shape, largest_word, np.int64)
    searched = power[:, plan.searched_rows]
    n_rows = searched.shape[1]
    starts = np.arange(n_rows) - plan.training_window.tested_rows_in_training_box(n_rows)
    levels = cell_averaging_thresholds(
        searched,
        plan.factors,
        plan.factor_shift,
        starts,
        plan.training_window.training_and_guard_counts,
    )
    out[:, plan.searched_rows] = np.minimum(levels, largest_word)
    return out


def _power_per_map_unit(plan: LookupTables, step: float, exponent: int, radar: Radar) -> float:
    """Return the power of one unit of the map, such that a tone keeps its power."""
    words = plan.words
    unit_weight = 2.0 ** (words.window_bits - 2)
    gain = plan.range_window.sum() / unit_weight * abs(plan.doppler_window).sum() / unit_weight
    below_point = words.doppler_bits - words.sample_bits - exponent
    amplitude = step / gain * 2.0**-below_point
    # A real tone has half its power at negative frequencies, which are dropped.
    sides = 1 if radar.frame.chirp.sampling == "complex" else 2
    return float(sides * amplitude**2 / plan.n_channels * 2.0**-plan.power_left_shift)


@kernel(plain=AS_WRITTEN)
def apply_window_and_pad(
    points: np.ndarray,
    weights: np.ndarray,
    shifts: np.ndarray,
    n_bins: int,
    bits: int,
    rounding_code: int,
) -> tuple[np.ndarray, int]:
    """Multiply words (a, b, n_points, 2) by weights (n_points,), shift right and pad with zeros.

    Parameters
    ----------
    points : integer array
        Any strides; a transposed array performs the corner turn.
    weights : int64 array
    shifts : int64 array (a, b, n_points)
        Bits to shift each product right: the fraction bits of a weight, and the alignment of
        several exponents.
    n_bins : int
        Points of the transform.
    bits : int
        Bits of the result; larger values are saturated.
    rounding_code : int
        Code of `word_lengths.ROUNDING_CODES`.

    Returns
    -------
    int32 array (a, b, n_bins, 2), and the number of saturated parts.
    """
    n_a, n_b, n_points, _ = points.shape
    out = np.zeros((n_a, n_b, n_bins, 2), np.int32)
    n_overflows = 0
    for a in range(n_a):
        for b in range(n_b):
            for k in range(n_points):
                for part in range(2):
                    product = points[a, b, k, part] * weights[k]
                    word = shift_right_rounded(product, shifts[a, b, k], rounding_code)
                    saturated = saturate(word, bits)
                    n_overflows += saturated != word
                    out[a, b, k, part] = saturated
    return out, n_overflows


@kernel(plain=AS_WRITTEN)
def sum_channel_powers(spectrum: np.ndarray, shifts: np.ndarray, rounding_code: int) -> np.ndarray:
    """Sum squares of words (channel, range, velocity, 2) over channels, (velocity, range) int64.

    `shifts` (channel, range): bits to shift the square of each right, for one exponent.
    """
    n_channels, n_range, n_velocity, _ = spectrum.shape
    out = np.zeros((n_velocity, n_range), np.int64)
    for channel in range(n_channels):
        for row in range(n_range):
            for v in range(n_velocity):
                re, im = int(spectrum[channel, row, v, 0]), int(spectrum[channel, row, v, 1])
                out[v, row] += shift_right_rounded(
                    re * re + im * im, shifts[channel, row], rounding_code
                )
    return out


@kernel(plain=AS_WRITTEN)
def log2_of_powers(
    power: np.ndarray, table: np.ndarray, table_bits: int, fraction_bits: int
) -> np.ndarray:
    """Return the logarithm to base 2 of each word, with `fraction_bits` fraction bits, uint16.

    The position of the leading one is the integer part; the `table_bits` after it choose an entry
    of the `table` of log2(1 + f). Within `max_log2_error` of the true one; 0 for a word of 0.
    """
    out = np.empty(power.shape, np.uint16)
    for v in range(power.shape[0]):
        for row in range(power.shape[1]):
            word = power[v, row]
            leading_bit = np.int64(0)
            while word >> (leading_bit + 1):
                leading_bit += 1
            remainder = word - (np.int64(1) << leading_bit) if word else np.int64(0)
            if leading_bit > table_bits:
                address = remainder >> (leading_bit - table_bits)
            else:
                address = remainder << (table_bits - leading_bit)
            integer_part = leading_bit << fraction_bits
            out[v, row] = integer_part + table[address] if word else 0
    return out


def max_log2_error(words: WordLengths) -> float:
    """Return the largest error of the logarithm to base 2 of a word above 0; times 3.01 in dB.

    Half an interval of the table, where it is steepest, and half a fraction step.
    """
    return float(
        np.log2(1 + 2.0 ** -(words.log_table_bits + 1)) + 2.0 ** -(words.log_fraction_bits + 1)
    )
