"""Kernels in whole numbers against Python's own integers and fractions, bit by bit.

The witness knows no words of 64 bits and no shifts: every block is exact arithmetic on fractions,
then one rounding and one saturation, as the definitions say.
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
from dechirp.processing.fixed_point.samples import to_integer_samples
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.theory.windows import window_weights

N_TRAINING, N_GUARD, OFFSET = 2, 1, 1.5
ROUND = {
    "convergent": round,  # Python's, to the even neighbour
    "half-up": lambda x: math.floor(x + Fraction(1, 2)),
    "truncate": math.floor,
}


def word(x: Fraction, bits: int, words: WordLengths) -> tuple[int, int]:
    """The word that holds x, and 1 where it had to be saturated."""
    whole = ROUND[words.rounding](x)
    kept = min(max(whole, -(2 ** (bits - 1))), 2 ** (bits - 1) - 1)
    return kept, int(kept != whole)


def turn(k: int, n: int, words: WordLengths) -> tuple[Fraction, Fraction]:
    one = 2 ** (words.twiddle_bits - 2)
    phase = -2 * math.pi * k / n
    return Fraction(round(math.cos(phase) * one), one), Fraction(round(math.sin(phase) * one), one)


def block_shift(parts, turns, bits: int) -> int:
    """The least shift with which no result can be too large."""
    largest = max(max(abs(re), abs(im)) for part in parts for re, im in part)
    growth = 1 + max(abs(c) + abs(s) for c, s in turns)
    shift = 0
    while largest * growth / 2**shift > 2 ** (bits - 1) - 1:
        shift += 1
    return shift


def transform(points, bits, words):
    """Transform by halves: even and odd samples, down to one. Numbers, shifts, overflows."""
    n = len(points)
    parts = [[point] for point in points]  # part i of m: the transform of samples i, i + m, ...
    shifts, overflows = [], []
    while len(parts) > 1:
        size, m = len(parts[0]), len(parts) // 2
        turns = [turn(k, 2 * size, words) for k in range(size)]
        shift = {"block": block_shift(parts, turns, bits), "halving": 1, "none": 0}[words.scaling]
        joined, lost = [], 0
        for even, odd in zip(parts[:m], parts[m:], strict=True):
            both = [None] * (2 * size)
            for k in range(size):
                (c, s), (re, im) = turns[k], odd[k]
                product = (re * c - im * s, re * s + im * c)
                for at, sign in ((k, 1), (k + size, -1)):
                    made = [
                        word((e + sign * p) / 2**shift, bits, words)
                        for e, p in zip(even[k], product, strict=True)
                    ]
                    both[at] = tuple(number for number, _ in made)
                    lost += sum(more for _, more in made)
            joined.append(both)
        parts = joined
        shifts.append(shift)
        overflows.append(lost)
    assert len(parts[0]) == n
    return parts[0], shifts, overflows


def window(kind, n, words, signs=False):
    one = 2 ** (words.window_bits - 2)
    weights = [Fraction(round(float(w) * one), one) for w in window_weights(kind, n)]
    return [-w if signs and k % 2 else w for k, w in enumerate(weights)]


def machine(samples, n_range, n_velocity, window_kind, words, is_complex):
    """Every block of the chain, from (chirp, channel, sample, 2)."""
    n_chirps, n_channels, n_samples, _ = samples.shape
    made = {}
    up = Fraction(2) ** (words.range_bits - words.sample_bits)
    weights = window(window_kind, n_samples, words)
    profiles = np.zeros((n_chirps, n_channels, n_range, 2), object)
    before = np.zeros_like(profiles)
    range_shifts = np.zeros((n_chirps, n_channels, int(math.log2(n_range))), object)
    range_overflows = 0
    for m in range(n_chirps):
        for c in range(n_channels):
            for i in range(n_samples):
                for part in range(2):
                    x = int(samples[m, c, i, part]) * weights[i] * up
                    before[m, c, i, part] = word(x, words.range_bits, words)[0]
            points = [tuple(point) for point in before[m, c]]
            found, range_shifts[m, c], lost = transform(points, words.range_bits, words)
            profiles[m, c] = found
            range_overflows = range_overflows + np.array(lost)
    n_rows = n_range if is_complex else n_range // 2 + 1
    profiles = profiles[:, :, :n_rows]
    made |= {"range_window": before, "range_fft": profiles, "range_shifts": range_shifts}
    made["range_overflows"] = range_overflows

    exponents = range_shifts.sum(axis=-1)
    weights = window(window_kind, n_chirps, words, signs=True)
    before = np.zeros((n_channels, n_rows, n_velocity, 2), object)
    spectrum = np.zeros_like(before)
    doppler_shifts = np.zeros((n_channels, n_rows, int(math.log2(n_velocity))), object)
    up = Fraction(2) ** (words.doppler_bits - words.range_bits)
    for c in range(n_channels):
        for row in range(n_rows):
            for m in range(n_chirps):
                down = Fraction(2) ** int(exponents.max() - exponents[m, c])
                for part in range(2):
                    x = int(profiles[m, c, row, part]) * weights[m] * up / down
                    before[c, row, m, part] = word(x, words.doppler_bits, words)[0]
            points = [tuple(point) for point in before[c, row]]
            spectrum[c, row], doppler_shifts[c, row], _ = transform(
                points, words.doppler_bits, words
            )
    made |= {"doppler_window": before, "doppler_fft": spectrum, "doppler_shifts": doppler_shifts}

    exponents = doppler_shifts.sum(axis=-1)
    up = Fraction(2) ** (
        words.power_bits - 2 * words.doppler_bits - math.ceil(math.log2(n_channels))
    )
    power = np.zeros((n_velocity, n_rows), object)
    for v in range(n_velocity):
        for row in range(n_rows):
            for c in range(n_channels):
                re, im = spectrum[c, row, v]
                x = (re * re + im * im) * up / 4 ** int(exponents.max() - exponents[c, row])
                power[v, row] += ROUND[words.rounding](x)
    made["power"] = power
    made["log_power"] = np.array([[logarithm(p, words) for p in line] for line in power])
    return made


def logarithm(power: int, words: WordLengths) -> int:
    if power == 0:
        return 0
    place = power.bit_length() - 1
    address = math.floor((Fraction(power, 2**place) - 1) * 2**words.log_table_bits)
    middle = (address + 0.5) / 2**words.log_table_bits
    behind = 2**words.log_fraction_bits
    return place * behind + round(math.log2(1 + middle) * behind)


def threshold(power, searched: range, words: WordLengths):
    """Sum of each ring times the offset over its number of cells, by what a ring is."""
    n_v = len(power)
    half = N_TRAINING + N_GUARD
    rings = []
    for row in searched:
        first = min(max(row - half, searched.start), searched.stop - 1 - 2 * half)
        rings.append(
            [
                (dv, other)
                for other in range(first, first + 2 * half + 1)
                for dv in range(-half, half + 1)
                if abs(dv) > N_GUARD or abs(other - row) > N_GUARD
            ]
        )
    ratios = [Fraction(float(np.float32(OFFSET))) / len(ring) for ring in rings]
    shift = 0
    while max(ratios) * 2 ** (shift + 1) < 2**words.factor_bits:
        shift += 1
    largest = 2**words.power_bits - 1
    made = np.full(power.shape, largest, object)
    for row, ring, ratio in zip(searched, rings, ratios, strict=True):
        factor = min(round(ratio * 2**shift), 2**words.factor_bits - 1)
        for v in range(n_v):
            total = sum(power[(v + dv) % n_v, other] for dv, other in ring)
            made[v, row] = min(math.floor(Fraction(total * factor, 2**shift)), largest)
    return made


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
    # Shorter than the square of a word: powers are rounded.
    (replace(UNEQUAL, power_bits=17), "complex"),
]


@pytest.mark.parametrize(("words", "sampling"), CASES)
def test_every_block_is_what_exact_fractions_rounded_once_give(radar, words, sampling):
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
    half = 2 ** (words.sample_bits - 1)
    # Chirps of several sizes have several exponents; the first is of full scale.
    sizes = half >> np.array([0, 0, 3, 1, 6, 0, 2])
    drawn = rng.uniform(-1, 1, size=(7, 2, 27, 2)) * sizes[:, None, None, None]
    drawn[0] = np.where(drawn[0] > 0, half - 1, -half)
    samples = np.floor(drawn).astype(np.int32)
    dims = ("chirp", "rx", "sample", "iq")
    if sampling == "real":
        cube = xr.DataArray(samples[..., 0], dims=dims[:3])
        samples[..., 1] = 0
    else:
        cube = xr.DataArray(samples, dims=dims)

    plan = make_lookup_tables(radar, chain, words)
    whole, _ = to_integer_samples(cube, radar, words)
    found = {block.name: block for block in stage_outputs(whole, radar, plan)}
    expected = machine(samples, 32, 8, "hann", words, sampling == "complex")
    searched = range(plan.searched_rows.start, plan.searched_rows.stop)
    expected["threshold"] = threshold(expected["power"], searched, words)
    expected["detected"] = expected["power"] > expected["threshold"]
    assert found["range_fft"].overflows.tolist() == expected.pop("range_overflows").tolist()
    for name, integers in expected.items():
        assert (found[name].integers == integers).all(), name
        most = 2 ** (found[name].bits - found[name].is_signed)
        assert np.max(found[name].integers) < most, name
    assert expected["detected"].any()
    assert expected["range_shifts"].sum() > 0 or words.scaling == "none"
