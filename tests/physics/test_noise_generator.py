"""Counter-based noise: Philox words and normal variates generated from them."""

import numpy as np
import pytest
from scipy import special, stats

from dechirp.core.gaussian_noise import (
    BLOCK,
    add_box_muller_pairs,
    add_white_noise,
    fill_philox_words,
)
from dechirp.core.threads import limit_threads
from nightly import nightly

# A correct generator fails a test once in 2e6 runs.
CHANCE = 5e-7


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((2**32 - 1,) * 4, (2**32 - 1,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_matches_published_vectors(counter, key, words):
    generated_words = np.zeros((4, 1), np.uint32)
    fill_philox_words(
        _join_words(*counter[:2]), _join_words(*counter[2:]), _join_words(*key), generated_words
    )
    assert tuple(generated_words[:, 0]) == words


def test_philox_word_depends_only_on_counter():
    stream, single_word = np.zeros((4, 100), np.uint32), np.zeros((4, 1), np.uint32)
    first_counter = np.uint64(2**32 - 50)  # the counter carries
    fill_philox_words(first_counter, np.uint64(3), np.uint64(7), stream)
    for i in (0, 49, 50, 99):
        fill_philox_words(first_counter + np.uint64(i), np.uint64(3), np.uint64(7), single_word)
        assert (single_word[:, 0] == stream[:, i]).all()


def test_pairs_match_box_muller_in_double_precision():
    rng = np.random.default_rng(3)
    offsets = np.arange(3000)
    at_root_half = int(2**31.5) + offsets - 1500  # where the exponent of u steps
    x = np.concatenate(
        [
            rng.integers(2**32, size=200_000),
            offsets,
            2**32 - 1 - offsets,
            2**31 + offsets - 1500,
            at_root_half,
        ]
    )
    y = rng.integers(2**32, size=x.size)
    y[-offsets.size :], y[:100] = 2**32 - 1, 0
    pairs = _generate_pairs(x, y)
    low_bits = y & 255
    below_one = ((2**32 - 1 - x) + (255.5 - low_bits) / 256) / 2**32
    u = (x + (low_bits + 0.5) / 256) / 2**32
    amplitude = np.sqrt(-2 * np.where(u < 0.5, np.log(u), np.log1p(-below_one)))
    # At most four rounding errors of 6e-8 in the logarithm, half of that in its square root.
    assert abs(abs(pairs) / amplitude - 1).max() < 3e-7
    turn = ((y >> 8) % 2**22 - 2**21 + 0.5) / 2**22  # fraction of a quarter cycle
    direction = np.exp(0.5j * np.pi * turn)
    direction = np.where(y & 2**30, direction.imag + 1j * direction.real, direction)
    direction *= np.where(y & 2**31, -1, 1)
    assert abs(pairs / abs(pairs) - direction).max() < 2e-7


def test_extreme_amplitudes_match_their_formulas():
    max_amplitude, min_amplitude = abs(
        _generate_pairs(np.array([0, 2**32 - 1]), np.array([0, 255]))
    )
    assert max_amplitude == pytest.approx(np.sqrt(82 * np.log(2)), rel=3e-7)
    assert min_amplitude == pytest.approx(np.sqrt(2.0**-40), rel=3e-7)


def test_directions_cover_circle_in_equal_steps():
    # All combinations of the eight highest bits: one in each 256th of a cycle.
    y = (np.arange(256) << 24) + 2**23
    turns = np.angle(_generate_pairs(np.full(256, 2**30), y)) / (2 * np.pi) % 1
    assert sorted(np.floor(256 * turns).astype(int)) == list(range(256))


def test_first_four_moments_are_normal():
    parts = draw_noise(1_000_000, seed=11).view(np.float32).astype(float)
    n = parts.size
    limit = stats.norm.isf(CHANCE / 8)
    for power, mean, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        # Variance of x^k: the mean of x^2k less the square of that of x^k.
        assert abs(np.mean(parts**power) - mean) < limit * np.sqrt(variance / n), power


def test_amplitudes_and_directions_follow_their_distributions():
    samples = draw_noise(1_000_000, seed=12)
    share = np.exp(-(abs(samples.astype(complex)) ** 2) / 2)
    turns = np.angle(samples) / (2 * np.pi) % 1
    for name, uniform in (("amplitude", share), ("direction", turns)):
        assert stats.kstest(uniform, "uniform").pvalue > CHANCE, name
    # Joint distribution: directions of weak and strong samples.
    counts, *_ = np.histogram2d(share, turns, bins=16, range=[[0, 1], [0, 1]])
    assert stats.chisquare(counts.ravel()).pvalue > CHANCE
    assert stats.kstest(samples.real[:200_000], "norm").pvalue > CHANCE


@nightly
def test_tail_probabilities_are_gaussian():
    # 2^24 amplitudes, 2^25 parts: 5 beyond 5.5 sigma; smaller thresholds are tested, too.
    part_counts, amplitude_counts = np.zeros(6), np.zeros(6)
    steps = np.arange(3.0, 5.6, 0.5)
    for seed in range(8):
        samples = draw_noise(2**21, seed=100 + seed)
        part_counts += [np.count_nonzero(abs(samples.view(np.float32)) > step) for step in steps]
        amplitude_counts += [np.count_nonzero(abs(samples) > step) for step in steps]
    for counts, law, n in (
        (part_counts, special.erfc(steps / np.sqrt(2)), 2**25),
        (amplitude_counts, np.exp(-(steps**2) / 2), 2**24),
    ):
        for count, probability in zip(counts, law, strict=True):
            low, high = stats.poisson.interval(1 - CHANCE, n * probability)
            assert low <= count <= high


def test_samples_at_any_lag_are_independent():
    unit = draw_noise(2**18, seed=13).astype(complex) / np.sqrt(2)
    power = abs(unit) ** 2 - 1
    # All lags up to half the length at once, including blocks and half blocks.
    n_each = unit.size - np.arange(1, unit.size // 2)
    for second_series, law in (
        (unit, lambda chance: np.sqrt(-np.log(chance))),
        (unit.conj(), lambda chance: np.sqrt(-np.log(chance))),
        (power, lambda chance: stats.norm.isf(chance / 2)),
    ):
        first_series = power if second_series is power else unit
        spectra = np.fft.fft([first_series, second_series], 2 * unit.size)
        lags = np.fft.ifft(spectra[0] * spectra[1].conj())
        correlations = abs(lags[1 : unit.size // 2]) / np.sqrt(n_each)  # of unit variance
        assert correlations.max() < law(CHANCE / correlations.size)
        block_correlations = correlations[[BLOCK // 4 - 1, BLOCK // 2 - 1, BLOCK - 1]]
        assert block_correlations.max() < law(CHANCE / 3)


def test_streams_and_successive_draws_are_independent():
    rng = np.random.default_rng(5)
    streams = [draw_noise(2**18, seed=5), draw_noise(2**18, seed=6)]
    for _ in range(2):
        samples = np.zeros(2**18, np.complex64)
        add_white_noise(samples, 2.0, rng)
        streams.append(samples)
    assert (streams[0] == streams[2]).all()
    for stream in (streams[1], streams[3]):
        # Correlation of mean 0 and variance 4 / n: exponentially distributed power.
        correlation = abs(np.vdot(streams[0].astype(complex), stream)) / 2**18
        assert correlation < 2 * np.sqrt(np.log(1 / CHANCE) / 2**18)


@pytest.mark.parametrize("dtype", [np.complex64, np.float32, np.complex128, np.float64])
def test_noise_power_is_right_for_any_dtype_and_shape(dtype):
    shape = (3, 7, 14_303)
    noise_of_threads = []
    for n_threads in (1, 3):
        samples = np.ones(shape, dtype)
        with limit_threads(n_threads):
            add_white_noise(samples, 0.25, np.random.default_rng(1))
        noise_of_threads.append(samples)
    assert (noise_of_threads[0] == noise_of_threads[1]).all()
    noise = noise_of_threads[0].ravel() - 1
    # Variance of the power over its squared mean.
    power_variance = 1 if np.iscomplexobj(noise) else 2
    limit = stats.norm.isf(CHANCE)
    relative_error = np.mean(abs(noise.astype(complex)) ** 2) / 0.25 - 1
    assert abs(relative_error) < limit * np.sqrt(power_variance / noise.size)
    # Samples of the last, incomplete block are noise like all others.
    last_block = noise[-(noise.size % (BLOCK // 2)) :]
    relative_error = np.mean(abs(last_block.astype(complex)) ** 2) / 0.25 - 1
    assert (
        abs(relative_error)
        < limit * np.sqrt(power_variance / last_block.size) + 12 / last_block.size
    )


def draw_noise(n: int, *, seed: int) -> np.ndarray:
    """Draw complex noise, each part of unit variance."""
    samples = np.zeros(n, np.complex64)
    add_white_noise(samples, 2.0, np.random.default_rng(seed))
    return samples


def _generate_pairs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    numbers = np.zeros(2 * x.size, np.float32)
    add_box_muller_pairs(numbers, x.astype(np.uint32), y.astype(np.uint32), np.float32(1))
    return numbers[::2].astype(float) + 1j * numbers[1::2]


def _join_words(low: int, high: int) -> np.uint64:
    return np.uint64(low + (high << 32))
