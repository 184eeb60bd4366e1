"""Fixed-point processing chain against exact Python integers and fractions, bit by bit.

The reference uses no 64-bit words and no shifts: every block is exact arithmetic on fractions
followed by one rounding and one saturation, as defined.
"""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.processing.fixed_point.chain import stage_outputs
from dechirp.processing.fixed_point.lookup_tables import make_lookup_tables
from dechirp.processing.fixed_point.samples import to_integer_samples_and_step
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.theory.windows import window_weights
from nightly import nightly_except

N_TRAINING, N_GUARD, OFFSET = 2, 1, 1.5
ROUND = {
    "convergent": round,  # Python rounds half to even
    "half-up": lambda x: math.floor(x + Fraction(1, 2)),
    "truncate": math.floor,
}


def round_to_word(x: Fraction, bits: int, word_lengths: WordLengths) -> tuple[int, int]:
    """Round x to a word; return the word, and 1 if it was saturated."""
    integer = ROUND[word_lengths.rounding](x)
    clipped_integer = min(max(integer, -(2 ** (bits - 1))), 2 ** (bits - 1) - 1)
    return clipped_integer, int(clipped_integer != integer)


def compute_twiddle(k: int, n: int, word_lengths: WordLengths) -> tuple[Fraction, Fraction]:
    scale = 2 ** (word_lengths.twiddle_bits - 2)
    phase = -2 * math.pi * k / n
    return Fraction(round(math.cos(phase) * scale), scale), Fraction(
        round(math.sin(phase) * scale), scale
    )


def find_block_shift(parts, factors, bits: int) -> int:
    """Return the smallest shift for which no result can overflow."""
    largest = max(max(abs(re), abs(im)) for part in parts.values() for re, im in part)
    growth = 2 * max(abs(c) + abs(s) for c, s in factors)
    shift = 0
    while largest * growth / 2**shift > 2 ** (bits - 1) - 1:
        shift += 1
    return shift


def transform_by_quarters(points, bits, word_lengths):
    """Transform by radix 2^2 as He and Torkelson; return the numbers, shifts and overflow counts.

    Part r of m: the points whose transform has the bins r, r + m, ... In the first stage of a pair
    the differences should be multiplied by W^q. The second stage does so with both halves at once:
    W^(q + size) = -i W^q, if a part of 4 x size points has entered the pair.
    """
    n = len(points)
    parts = {0: points}
    shifts, overflows = [], []
    while len(parts) < n:
        m, size = len(parts), n // len(parts) // 2
        is_second = len(shifts) % 2 == 1
        exponents = range(3 * size if is_second else 1)
        factors = [compute_twiddle(k, 4 * size, word_lengths) for k in exponents]
        shift = {"block": find_block_shift(parts, factors, bits), "halving": 1, "none": 0}[
            word_lengths.scaling
        ]
        stage_parts, n_saturated = {}, 0
        for r, part in parts.items():
            lacks_factor = int(is_second and r >= m // 2)
            for bin_index, sign in ((r, 1), (r + m, -1)):
                stage_parts[bin_index] = []
                for q, (a, b) in enumerate(zip(part[:size], part[size:], strict=True)):
                    turned_b = (b[1], -b[0]) if lacks_factor else b
                    re, im = (a[part] + sign * turned_b[part] for part in range(2))
                    c, s = factors[q * (lacks_factor + (1 - sign)) if is_second else 0]
                    product = (re * c - im * s, re * s + im * c)
                    results = [round_to_word(x / 2**shift, bits, word_lengths) for x in product]
                    stage_parts[bin_index].append(tuple(number for number, _ in results))
                    n_saturated += sum(overflow for _, overflow in results)
        parts = stage_parts
        shifts.append(shift)
        overflows.append(n_saturated)
    return [parts[k][0] for k in range(n)], shifts, overflows


def make_window(kind, n, word_lengths, signs=False):
    scale = 2 ** (word_lengths.window_bits - 2)
    weights = [Fraction(round(float(w) * scale), scale) for w in window_weights(kind, n)]
    return [-w if signs and k % 2 else w for k, w in enumerate(weights)]


def simulate_chain(samples, n_range, n_velocity, window_kind, word_lengths, is_complex):
    """Compute every block of the chain from samples (chirp, channel, sample, 2)."""
    n_chirps, n_channels, n_samples, _ = samples.shape
    blocks = {}
    gain = Fraction(2) ** (word_lengths.range_bits - word_lengths.sample_bits)
    weights = make_window(window_kind, n_samples, word_lengths)
    profiles = np.zeros((n_chirps, n_channels, n_range, 2), object)
    windowed_samples = np.zeros_like(profiles)
    range_shifts = np.zeros((n_chirps, n_channels, int(math.log2(n_range))), object)
    range_overflows = 0
    for m in range(n_chirps):
        for c in range(n_channels):
            for i in range(n_samples):
                for part in range(2):
                    x = int(samples[m, c, i, part]) * weights[i] * gain
                    windowed_samples[m, c, i, part] = round_to_word(
                        x, word_lengths.range_bits, word_lengths
                    )[0]
            points = [tuple(point) for point in windowed_samples[m, c]]
            profile, range_shifts[m, c], overflows = transform_by_quarters(
                points, word_lengths.range_bits, word_lengths
            )
            profiles[m, c] = profile
            range_overflows = range_overflows + np.array(overflows)
    n_rows = n_range if is_complex else n_range // 2 + 1
    profiles = profiles[:, :, :n_rows]
    blocks |= {
        "range_window": windowed_samples,
        "range_fft": profiles,
        "range_shifts": range_shifts,
    }
    blocks["range_overflows"] = range_overflows

    exponents = range_shifts.sum(axis=-1)
    weights = make_window(window_kind, n_chirps, word_lengths, signs=True)
    windowed_samples = np.zeros((n_channels, n_rows, n_velocity, 2), object)
    spectrum = np.zeros_like(windowed_samples)
    doppler_shifts = np.zeros((n_channels, n_rows, int(math.log2(n_velocity))), object)
    gain = Fraction(2) ** (word_lengths.doppler_bits - word_lengths.range_bits)
    for c in range(n_channels):
        for row in range(n_rows):
            for m in range(n_chirps):
                attenuation = Fraction(2) ** int(exponents.max() - exponents[m, c])
                for part in range(2):
                    x = int(profiles[m, c, row, part]) * weights[m] * gain / attenuation
                    windowed_samples[c, row, m, part] = round_to_word(
                        x, word_lengths.doppler_bits, word_lengths
                    )[0]
            points = [tuple(point) for point in windowed_samples[c, row]]
            spectrum[c, row], doppler_shifts[c, row], _ = transform_by_quarters(
                points, word_lengths.doppler_bits, word_lengths
            )
    blocks |= {
        "doppler_window": windowed_samples,
        "doppler_fft": spectrum,
        "doppler_shifts": doppler_shifts,
    }

    exponents = doppler_shifts.sum(axis=-1)
    gain = Fraction(2) ** (
        word_lengths.power_bits - 2 * word_lengths.doppler_bits - math.ceil(math.log2(n_channels))
    )
    power = np.zeros((n_velocity, n_rows), object)
    for v in range(n_velocity):
        for row in range(n_rows):
            for c in range(n_channels):
                re, im = spectrum[c, row, v]
                x = (re * re + im * im) * gain / 4 ** int(exponents.max() - exponents[c, row])
                power[v, row] += ROUND[word_lengths.rounding](x)
    blocks["power"] = power
    blocks["log_power"] = np.array(
        [[compute_logarithm(p, word_lengths) for p in line] for line in power]
    )
    return blocks


def compute_logarithm(power: int, word_lengths: WordLengths) -> int:
    if power == 0:
        return 0
    exponent = power.bit_length() - 1
    address = math.floor((Fraction(power, 2**exponent) - 1) * 2**word_lengths.log_table_bits)
    mantissa = (address + 0.5) / 2**word_lengths.log_table_bits
    fraction_scale = 2**word_lengths.log_fraction_bits
    return exponent * fraction_scale + round(math.log2(1 + mantissa) * fraction_scale)


def compute_threshold(power, searched_rows: range, word_lengths: WordLengths):
    """Compute thresholds: sum of each training window times the offset over its number of cells."""
    n_v = len(power)
    half = N_TRAINING + N_GUARD
    windows = []
    for row in searched_rows:
        first = min(max(row - half, searched_rows.start), searched_rows.stop - 1 - 2 * half)
        windows.append(
            [
                (dv, training_row)
                for training_row in range(first, first + 2 * half + 1)
                for dv in range(-half, half + 1)
                if abs(dv) > N_GUARD or abs(training_row - row) > N_GUARD
            ]
        )
    ratios = [Fraction(float(np.float32(OFFSET))) / len(window_cells) for window_cells in windows]
    shift = 0
    while max(ratios) * 2 ** (shift + 1) < 2**word_lengths.factor_bits:
        shift += 1
    largest = 2**word_lengths.power_bits - 1
    thresholds = np.full(power.shape, largest, object)
    for row, window_cells, ratio in zip(searched_rows, windows, ratios, strict=True):
        factor = min(round(ratio * 2**shift), 2**word_lengths.factor_bits - 1)
        for v in range(n_v):
            total = sum(power[(v + dv) % n_v, training_row] for dv, training_row in window_cells)
            thresholds[v, row] = min(math.floor(Fraction(total * factor, 2**shift)), largest)
    return thresholds


UNEQUAL = WordLengths(
    sample_bits=12,
    window_bits=10,
    twiddle_bits=9,
    range_bits=14,
    doppler_bits=11,
    power_bits=26,
    log_fraction_bits=6,
    log_table_bits=5,
    factor_bits=7,
)
CASES = [
    *(
        (replace(UNEQUAL, rounding=rounding, scaling=scaling), "complex")
        for rounding in ROUND
        for scaling in ("block", "halving", "none")
    ),
    (WordLengths(), "complex"),
    (WordLengths(), "real"),
    (WordLengths(range_bits=24, doppler_bits=24, twiddle_bits=24, sample_bits=24), "complex"),
    # Power words shorter than the square of a word: powers are rounded.
    (replace(UNEQUAL, power_bits=17), "complex"),
]


@pytest.mark.parametrize(("word_lengths", "sampling"), nightly_except(4, CASES))
def test_every_block_matches_exact_fractions_rounded_once(radar, word_lengths, sampling):
    chirp = replace(radar.frame.chirp, n_samples=27, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=7))
    chain = dc.Chain(
        n_range_bins=32,
        n_velocity_bins=8,
        cfar=dc.Cfar(
            estimator=dc.cfar.CellAveraging(),
            n_training=dc.Cells(range=N_TRAINING, velocity=N_TRAINING),
            n_guard=dc.Cells(range=N_GUARD, velocity=N_GUARD),
            offset=OFFSET,
        ),
    )
    rng = np.random.default_rng(5)
    half = 2 ** (word_lengths.sample_bits - 1)
    # Chirps of different amplitudes have different exponents; the first one has full scale.
    sizes = half >> np.array([0, 0, 3, 1, 6, 0, 2])
    noise = rng.uniform(-1, 1, size=(7, 2, 27, 2)) * sizes[:, None, None, None]
    noise[0] = np.where(noise[0] > 0, half - 1, -half)
    samples = np.floor(noise).astype(np.int32)
    dims = ("chirp", "rx", "sample", "iq")
    if sampling == "real":
        cube = xr.DataArray(samples[..., 0], dims=dims[:3])
        samples[..., 1] = 0
    else:
        cube = xr.DataArray(samples, dims=dims)

    plan = make_lookup_tables(radar, chain, word_lengths)
    integer_samples, _ = to_integer_samples_and_step(cube, radar, word_lengths)
    outputs = {block.name: block for block in stage_outputs(integer_samples, radar, plan)}
    expected = simulate_chain(samples, 32, 8, "hann", word_lengths, sampling == "complex")
    searched_rows = range(plan.searched_rows.start, plan.searched_rows.stop)
    expected["threshold"] = compute_threshold(expected["power"], searched_rows, word_lengths)
    expected["detected"] = expected["power"] > expected["threshold"]
    assert outputs["range_fft"].overflows.tolist() == expected.pop("range_overflows").tolist()
    for name, integers in expected.items():
        assert (outputs[name].integers == integers).all(), name
        limit = 2 ** (outputs[name].bits - outputs[name].is_signed)
        assert np.max(outputs[name].integers) < limit, name
    assert expected["detected"].any()
    assert expected["range_shifts"].sum() > 0 or word_lengths.scaling == "none"
