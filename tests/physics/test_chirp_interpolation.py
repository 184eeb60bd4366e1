"""Interpolation of lost and damaged chirps, against the frame before the damage.

A missing chirp of M takes 1/M of the noise and of the information; what the interpolation adds in
error is to stay below the noise of the chirp. Echoes are 60 dB (static) and 40 dB (moving) over
the noise after integration over the chirps and samples of a channel.
"""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.mitigation.chirp_interpolation import (
    interpolable_chirp_mask,
    interpolate_chirps,
)
from nightly import nightly_except
from radars import street_radar

N_ROUNDS, N_SAMPLES, N_RX = 64, 128, 2
STATIC_CELL, MOVING_CELL = 20.4, 37.7  # of the beat frequency
MISSING_ROUNDS = {
    "one": [20],
    "first": [0],
    "two adjacent": [40, 41],
    "four adjacent": [20, 21, 22, 23],
    "four apart": [12, 25, 38, 51],
    "last four": [60, 61, 62, 63],
}


def make_radar(sampling: str, n_slots: int) -> dc.Radar:
    radar = street_radar(n_samples=N_SAMPLES, n_chirps=N_ROUNDS, n_rx=N_RX, sampling=sampling)
    if n_slots == 1:
        return radar
    frame = replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=tuple(range(n_slots))))
    tx_m = tuple((0.0, 1.9e-3 * N_RX * tx, 0.0) for tx in range(n_slots))
    return dc.Radar(frame=frame, array=dc.Array(tx_m=tx_m, rx_m=radar.array.rx_m))


def tone(
    sampling: str, n_slots: int, snr_db: float, cell: float, doppler: float, rng
) -> np.ndarray:
    """Return an echo (chirp, rx, sample) of this SNR in noise of power 1 a sample."""
    chirp = np.arange(N_ROUNDS * n_slots)[:, None, None]
    phase = np.tile(rng.uniform(0, 2 * np.pi, (n_slots, N_RX)), (N_ROUNDS, 1))[:, :, None]
    cycles = cell * np.arange(N_SAMPLES) / N_SAMPLES + doppler * (chirp // n_slots) / N_ROUNDS
    amplitude = 10 ** (snr_db / 20) / np.sqrt(N_ROUNDS * N_SAMPLES)
    echo = amplitude * np.exp(1j * (2 * np.pi * cycles + phase))
    # A real tone has half the power of its amplitude squared, and half the noise is in its image.
    return echo if sampling == "complex" else np.sqrt(2) * echo.real


def echoes_and_noise(sampling: str, n_slots: int, seed: int):
    """Return the echoes, and them in noise, (chirp, rx, sample)."""
    rng = np.random.default_rng(seed)
    static = tone(sampling, n_slots, 60, STATIC_CELL, 0, rng)
    moving = tone(sampling, n_slots, 40, MOVING_CELL, rng.uniform(5, 25), rng)
    noise = rng.standard_normal((2, *static.shape))
    noise = (noise[0] + 1j * noise[1]) / np.sqrt(2) if sampling == "complex" else noise[0]
    return static, moving, static + moving + noise


def damage_and_interpolate(samples: np.ndarray, is_missing: np.ndarray, n_slots: int, seed: int):
    """Replace chirps by noise three times as strong as the samples, and interpolate them."""
    rng = np.random.default_rng(seed + 1000)
    damaged = samples.copy()
    rms = np.sqrt(np.mean(np.abs(samples) ** 2))
    damaged[is_missing] = 3 * rms * rng.standard_normal(samples[is_missing].shape)
    return interpolate_chirps(damaged, is_missing, n_slots)


def missing_mask(rounds, n_slots: int) -> np.ndarray:
    """Return the mask of chirps (chirp,): rounds in the second slot of two."""
    is_missing = np.zeros((N_ROUNDS, n_slots), bool)
    is_missing[rounds, -1] = True
    return is_missing.ravel()


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_slots", [1, 2])
@pytest.mark.parametrize("label", nightly_except(("first", "four adjacent"), MISSING_ROUNDS))
def test_interpolated_chirps_differ_from_echoes_by_less_than_noise(sampling, n_slots, label):
    dtype = np.complex64 if sampling == "complex" else np.float32
    is_missing = missing_mask(MISSING_ROUNDS[label], n_slots)
    n_missing = int(is_missing.sum())
    for seed in range(4):
        static, moving, noisy = echoes_and_noise(sampling, n_slots, seed)
        samples = noisy.astype(dtype)
        repaired = damage_and_interpolate(samples, is_missing, n_slots, seed)

        assert np.array_equal(repaired[~is_missing], samples[~is_missing])
        error = repaired[is_missing] - (static + moving)[is_missing]
        assert np.mean(np.abs(error) ** 2) < 1  # of the noise
        # The amplitude changes by the noise of the missing chirps, m / M of its variance, and by
        # the error in the cells of the echo: below that noise, or ten times it at the end of the
        # frame, where the echo is extrapolated. For 4 chirps and 40 dB 0.08 and 0.26 dB.
        error_ratio = 10 if N_ROUNDS - 1 in MISSING_ROUNDS[label] or label == "first" else 1
        variance_ratio = (1 + error_ratio) * n_missing / N_ROUNDS
        slot = slice(n_slots - 1, None, n_slots)
        for echo, snr_db in ((static, 60), (moving, 40)):
            energy = np.vdot(echo[slot], echo[slot]).real
            change = np.vdot(echo[slot], (repaired - samples)[slot]) / energy
            limit = 5 * np.sqrt(variance_ratio / N_RX) * 10 ** (-snr_db / 20)
            assert abs(change) < limit


def detect(samples: np.ndarray, radar: dc.Radar):
    cube = dc.simulate(dc.Scene(targets=[]), radar, impairments=[])
    return dc.detect(cube.copy(data=samples[None]), radar, dc.Chain(angle=None))


def row_of_echo(rows, radar: dc.Radar, cell: float):
    """Return the strongest detection at a beat frequency."""
    chirp = radar.frame.chirp
    range_m = chirp.range_m(cell * chirp.sample_rate_hz / N_SAMPLES)
    near = rows.isel(detection=abs(rows["range"].values - range_m) < 1.5 * chirp.range_resolution_m)
    return near.isel(detection=int(near["snr"].values.argmax()))


@pytest.mark.parametrize(("sampling", "n_slots"), [("complex", 1), ("real", 1), ("complex", 2)])
def test_detections_are_those_of_the_undamaged_frame(sampling, n_slots):
    radar = make_radar(sampling, n_slots)
    n_other = n_other_with_zeros = 0
    for seed, rounds in enumerate(MISSING_ROUNDS.values()):
        is_missing = missing_mask(rounds, n_slots)
        samples = echoes_and_noise(sampling, n_slots, seed)[2]
        samples = samples.astype(np.complex64 if sampling == "complex" else np.float32)
        before = detect(samples, radar)
        repaired = damage_and_interpolate(samples, is_missing, n_slots, seed)
        after = detect(repaired, radar)
        n_other += after.sizes["detection"] - 2
        zeros = np.where(is_missing[:, None, None], 0, samples)
        n_other_with_zeros += detect(zeros, radar).sizes["detection"] - 2
        # Without the last m of M chirps the variance of a frequency grows by (1 - m / M)^-3.
        loss = (1 - is_missing.sum() / n_slots / N_ROUNDS) ** -3 - 1
        for cell in (STATIC_CELL, MOVING_CELL):
            first, second = row_of_echo(before, radar, cell), row_of_echo(after, radar, cell)
            for name in ("range", "velocity"):
                limit = 5 * np.sqrt(loss) * float(first[f"{name}_std"])
                assert abs(float(second[name] - first[name])) < limit
    # Six maps of 8192 cells at most, at a probability of 1e-6: 0.05 expected, and more than 3 once
    # in 4 million.
    assert n_other <= 3
    assert n_other_with_zeros > 3


def test_noise_stays_without_signal():
    rng = np.random.default_rng(3)
    noise = (rng.standard_normal((2, N_ROUNDS, N_RX, N_SAMPLES)).T @ [1, 1j]).T
    samples = np.ascontiguousarray(noise, np.complex64)
    is_missing = missing_mask([5, 30], 1)
    # A cell of 16,384 is taken for an echo with a probability of 1e-7.
    assert not interpolate_chirps(samples, is_missing, 1)[is_missing].any()


@pytest.mark.parametrize(
    ("rounds", "is_possible"),
    [
        (range(0, 64, 4), True),
        (range(0, 64, 3), False),
        (range(20, 28), True),
        (range(20, 29), False),
        ([0], True),
    ],
)
def test_too_many_missing_chirps_become_zero(rounds, is_possible):
    is_missing = missing_mask(list(rounds), 2)
    assert interpolable_chirp_mask(is_missing, 2).any() == is_possible
    samples = echoes_and_noise("complex", 2, 0)[2].astype(np.complex64)
    repaired = interpolate_chirps(samples, is_missing, 2)
    assert repaired[is_missing].any() == is_possible
    assert np.array_equal(repaired[~is_missing], samples[~is_missing])


def test_frames_of_few_chirps_are_not_interpolated():
    assert not interpolable_chirp_mask(np.arange(15) == 3, 1).any()
    assert interpolable_chirp_mask(np.arange(16) == 3, 1).any()


@pytest.mark.parametrize("label", MISSING_ROUNDS)
def test_echoes_without_noise_are_stable(label):
    rng = np.random.default_rng(8)
    echo = tone("complex", 1, 60, STATIC_CELL, 0, rng) + tone("complex", 1, 40, 37, 9.7, rng)
    samples, is_missing = echo.astype(np.complex64), missing_mask(MISSING_ROUNDS[label], 1)
    error = interpolate_chirps(samples, is_missing, 1) - samples
    # The noise is taken for -80 dB of an echo in the map, -62 dB in a chirp; at the end of the
    # frame, extrapolation over four chirps amplifies it by up to 30 dB.
    assert np.mean(np.abs(error[is_missing]) ** 2) < 1e-3 * np.mean(np.abs(samples) ** 2)
