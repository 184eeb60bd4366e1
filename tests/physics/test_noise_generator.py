"""Noise from a counter: the words of Philox, and normal numbers made of them."""

import numba
import numpy as np
import pytest
from scipy import special, stats

from dechirp.core.gaussian_noise import BLOCK, add_gaussian_pairs, add_white_noise, philox

# A right generator fails a test once in 2e6 runs.
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
def test_words_are_those_of_the_published_vectors(counter, key, words):
    found = np.zeros((4, 1), np.uint32)
    philox(_joined(*counter[:2]), _joined(*counter[2:]), _joined(*key), found)
    assert tuple(found[:, 0]) == words


def test_a_word_depends_on_its_counter_alone():
    many, one = np.zeros((4, 100), np.uint32), np.zeros((4, 1), np.uint32)
    first = np.uint64(2**32 - 50)  # the counter carries
    philox(first, np.uint64(3), np.uint64(7), many)
    for i in (0, 49, 50, 99):
        philox(first + np.uint64(i), np.uint64(3), np.uint64(7), one)
        assert (one[:, 0] == many[:, i]).all()


def test_pairs_are_those_of_box_and_muller_in_double_precision():
    rng = np.random.default_rng(3)
    near = np.arange(3000)
    at_root_half = int(2**31.5) + near - 1500  # where the exponent of u steps
    x = np.concatenate(
        [
            rng.integers(2**32, size=200_000),
            near,
            2**32 - 1 - near,
            2**31 + near - 1500,
            at_root_half,
        ]
    )
    y = rng.integers(2**32, size=x.size)
    y[-near.size :], y[:100] = 2**32 - 1, 0
    found = _pairs(x, y)
    low = y & 255
    below_one = ((2**32 - 1 - x) + (255.5 - low) / 256) / 2**32
    u = (x + (low + 0.5) / 256) / 2**32
    amplitude = np.sqrt(-2 * np.where(u < 0.5, np.log(u), np.log1p(-below_one)))
    # Four rounding errors of 6e-8 at the most in the logarithm, and half of it in its root.
    assert abs(abs(found) / amplitude - 1).max() < 3e-7
    turn = ((y >> 8) % 2**22 - 2**21 + 0.5) / 2**22  # of a quarter
    direction = np.exp(0.5j * np.pi * turn)
    direction = np.where(y & 2**30, direction.imag + 1j * direction.real, direction)
    direction *= np.where(y & 2**31, -1, 1)
    assert abs(found / abs(found) - direction).max() < 2e-7


def test_the_largest_amplitude_is_the_one_that_is_stated():
    strongest, weakest = abs(_pairs(np.array([0, 2**32 - 1]), np.array([0, 255])))
    assert strongest == pytest.approx(np.sqrt(82 * np.log(2)), rel=3e-7)
    assert weakest == pytest.approx(np.sqrt(2.0**-40), rel=3e-7)


def test_every_direction_is_in_one_step_of_the_circle():
    # All combinations of the eight highest bits: one in each 256th of a turn.
    y = (np.arange(256) << 24) + 2**23
    turns = np.angle(_pairs(np.full(256, 2**30), y)) / (2 * np.pi) % 1
    assert sorted(np.floor(256 * turns).astype(int)) == list(range(256))


def test_moments_to_the_fourth_are_those_of_normal_numbers():
    parts = noise(1_000_000, seed=11).view(np.float32).astype(float)
    n = parts.size
    limit = stats.norm.isf(CHANCE / 8)
    for power, mean, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        # Variance of x^k: the mean of x^2k less the square of that of x^k.
        assert abs(np.mean(parts**power) - mean) < limit * np.sqrt(variance / n), power


def test_amplitudes_and_directions_have_their_laws():
    samples = noise(1_000_000, seed=12)
    share = np.exp(-(abs(samples.astype(complex)) ** 2) / 2)
    turns = np.angle(samples) / (2 * np.pi) % 1
    for name, uniform in (("amplitude", share), ("direction", turns)):
        assert stats.kstest(uniform, "uniform").pvalue > CHANCE, name
    # And of each other: directions of weak and strong samples.
    counts, *_ = np.histogram2d(share, turns, bins=16, range=[[0, 1], [0, 1]])
    assert stats.chisquare(counts.ravel()).pvalue > CHANCE
    assert stats.kstest(samples.real[:200_000], "norm").pvalue > CHANCE


def test_tails_are_as_heavy_as_they_should_be():
    # 2^24 amplitudes, 2^25 parts: 5 beyond 5.5 sigma, and each step of the tail on the way.
    beyond, amplitudes = np.zeros(6), np.zeros(6)
    steps = np.arange(3.0, 5.6, 0.5)
    for seed in range(8):
        samples = noise(2**21, seed=100 + seed)
        beyond += [np.count_nonzero(abs(samples.view(np.float32)) > step) for step in steps]
        amplitudes += [np.count_nonzero(abs(samples) > step) for step in steps]
    for counts, law, n in (
        (beyond, special.erfc(steps / np.sqrt(2)), 2**25),
        (amplitudes, np.exp(-(steps**2) / 2), 2**24),
    ):
        for count, probability in zip(counts, law, strict=True):
            low, high = stats.poisson.interval(1 - CHANCE, n * probability)
            assert low <= count <= high


def test_samples_at_any_lag_are_independent():
    unit = noise(2**18, seed=13).astype(complex) / np.sqrt(2)
    power = abs(unit) ** 2 - 1
    # All lags to half the length at once, those of blocks and of their halves among them.
    n_each = unit.size - np.arange(1, unit.size // 2)
    for other, law in (
        (unit, lambda chance: np.sqrt(-np.log(chance))),
        (unit.conj(), lambda chance: np.sqrt(-np.log(chance))),
        (power, lambda chance: stats.norm.isf(chance / 2)),
    ):
        of_one = power if other is power else unit
        spectra = np.fft.fft([of_one, other], 2 * unit.size)
        lags = np.fft.ifft(spectra[0] * spectra[1].conj())
        found = abs(lags[1 : unit.size // 2]) / np.sqrt(n_each)  # of unit variance
        assert found.max() < law(CHANCE / found.size)
        of_blocks = found[[BLOCK // 4 - 1, BLOCK // 2 - 1, BLOCK - 1]]
        assert of_blocks.max() < law(CHANCE / 3)


def test_streams_of_two_generators_and_of_one_after_the_other_are_independent():
    rng = np.random.default_rng(5)
    streams = [noise(2**18, seed=5), noise(2**18, seed=6)]
    for _ in range(2):
        samples = np.zeros(2**18, np.complex64)
        add_white_noise(samples, 2.0, rng)
        streams.append(samples)
    assert (streams[0] == streams[2]).all()
    for other in (streams[1], streams[3]):
        # Of mean 0 and variance 4 / n: exponential in power.
        together = abs(np.vdot(streams[0].astype(complex), other)) / 2**18
        assert together < 2 * np.sqrt(np.log(1 / CHANCE) / 2**18)


@pytest.mark.parametrize("kind", [np.complex64, np.float32, np.complex128, np.float64])
def test_noise_has_its_power_in_every_kind_of_sample_and_any_shape(kind, monkeypatch):
    shape = (3, 7, 14_303)
    drawn = []
    for n_threads in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda n=n_threads: n)
        samples = np.ones(shape, kind)
        add_white_noise(samples, 0.25, np.random.default_rng(1))
        drawn.append(samples)
    assert (drawn[0] == drawn[1]).all()
    added = drawn[0].ravel() - 1
    per_sample = 1 if np.iscomplexobj(added) else 2  # variance of the power over its square
    limit = stats.norm.isf(CHANCE)
    off = np.mean(abs(added.astype(complex)) ** 2) / 0.25 - 1
    assert abs(off) < limit * np.sqrt(per_sample / added.size)
    # The last samples, of a block that is not whole, are noise like all others.
    last = added[-(added.size % (BLOCK // 2)) :]
    off = np.mean(abs(last.astype(complex)) ** 2) / 0.25 - 1
    assert abs(off) < limit * np.sqrt(per_sample / last.size) + 12 / last.size


def noise(n: int, *, seed: int) -> np.ndarray:
    """Complex noise, each part of unit variance."""
    samples = np.zeros(n, np.complex64)
    add_white_noise(samples, 2.0, np.random.default_rng(seed))
    return samples


def _pairs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    numbers = np.zeros(2 * x.size, np.float32)
    add_gaussian_pairs(numbers, x.astype(np.uint32), y.astype(np.uint32), np.float32(1))
    return numbers[::2].astype(float) + 1j * numbers[1::2]


def _joined(low: int, high: int) -> np.uint64:
    return np.uint64(low + (high << 32))
