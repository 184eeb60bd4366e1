"""Direct simulation kernel against 50 digits and against a plain sum of exponentials."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from beat_signal import SPEED_OF_LIGHT, sum_echoes_in_fifty_digits, sum_echoes_plainly
from hypothesis import given
from hypothesis import strategies as st
from kernel_cases import (
    COMMON_CASES,
    WAVEFORMS,
    make_scatterers,
    make_transmission,
    simulate_echoes,
)

from dechirp.core.errors import InvalidSetting
from dechirp.simulation.kernels.direct import PreviousRamps, add_echoes
from nightly import nightly

# Specified error of the kernel, relative to the sum of the magnitudes of all echoes.
MAX_RELATIVE_ERROR = 1e-9


def iter_cells(shape, rng, n_cells):
    """Yield the first, the last and random cells."""
    yield 0, 0, 0
    yield tuple(axis - 1 for axis in shape)
    for _ in range(n_cells):
        yield tuple(int(rng.integers(axis)) for axis in shape)


CASES = COMMON_CASES | {
    "one at 50 m": ("short", {}, {"n": 1, "ranges_m": (50, 50), "speed_m_per_s": 30}),
    "one at 500 m": ("short", {}, {"n": 1, "ranges_m": (500, 500), "speed_m_per_s": 80}),
    "grazing": ("long", {}, {"n": 2, "ranges_m": (0.05, 0.1), "speed_m_per_s": 1}),
    "of eight terms": (
        "long",
        {},
        {"n": 3, "ranges_m": (5, 60), "speed_m_per_s": 40, "n_terms": 8, "varied": True},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_any_motion_and_array_matches_fifty_digits(case):
    rng = np.random.default_rng(sum(map(ord, case)))
    waveform, array, scene = CASES[case]
    transmission, n_samples = make_transmission(waveform, rng, **array)
    scatterers = make_scatterers(transmission, rng, **scene)
    echoes = simulate_echoes(scatterers, transmission, n_samples)

    for m, k, n in iter_cells(echoes.shape, rng, 20):
        exact, size = sum_echoes_in_fifty_digits(scatterers, transmission, m, k, n)
        assert abs(echoes[m, k, n] - exact) <= MAX_RELATIVE_ERROR * size


@pytest.mark.parametrize("range_m", [1500.0, 5000.0])
def test_error_grows_by_one_part_in_1e12_per_metre_of_range(range_m):
    # Three roundings by 2^-53 at most (range, delay, cycles) of 2 f R / c cycles: 5.4e-9 at 5 km.
    limit = 3 * 2 * np.pi * (2 * 77.2e9 * range_m / SPEED_OF_LIGHT) * 2.0**-53
    errors = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        transmission, n_samples = make_transmission("short", rng)
        scatterers = make_scatterers(
            transmission, rng, n=1, ranges_m=(0.97 * range_m, range_m), speed_m_per_s=40
        )
        echoes = simulate_echoes(scatterers, transmission, n_samples)
        for m, k, n in iter_cells(echoes.shape, rng, 12):
            exact, size = sum_echoes_in_fifty_digits(scatterers, transmission, m, k, n)
            errors.append(float(abs(echoes[m, k, n] - exact) / size))

    assert limit / 4 < max(errors) <= limit


def make_tail_scene(rng):
    """Make echoes from 10 m to 1.3 km of 8 us ramps every 9 us, some silent and some late."""
    transmission, _ = make_transmission("short", rng, n_tx=2, n_rx=2, n_chirps=5)
    transmission = transmission._replace(
        starts_s=np.array([0.0, 9e-6, 18e-6, 27.5e-6, 36.25e-6]) - 2e-5
    )
    weights = np.vstack([np.full((1, 2), np.nan), transmission.weights[:-1]])
    weights[2, 1] = 0
    previous = PreviousRamps(
        gaps_s=np.concatenate([[np.nan], np.diff(transmission.starts_s)]),
        weights=weights,
        ramp_duration_s=8e-6,
    )
    ranges_m = np.array([10.0, 50.0, 200.0, 400.0, 700.0, 1300.0])
    scatterers = make_scatterers(
        transmission, rng, n=len(ranges_m), ranges_m=(1, 1), speed_m_per_s=50, varied=True
    )
    scatterers.path_m[0] *= ranges_m[:, None]
    return (
        scatterers._replace(amplitudes=scatterers.amplitudes * ranges_m**2),
        transmission,
        previous,
    )


@pytest.mark.parametrize("late", ["onset", "tail"])
def test_late_echoes_match_fifty_digits(late):
    rng = np.random.default_rng(5)
    scatterers, transmission, previous = make_tail_scene(rng)
    # 1.3 km is 700,000 wavelengths: rounding of the range gives 3e-9 rad.
    for indices, tolerance in [(slice(0, 4), MAX_RELATIVE_ERROR), (slice(4, 6), 5e-9)]:
        subset = scatterers._replace(
            path_m=scatterers.path_m[:, indices],
            amplitudes=scatterers.amplitudes[indices],
            tx_gains=scatterers.tx_gains[:, indices],
            rx_gains=scatterers.rx_gains[:, indices],
            chirp_factors=scatterers.chirp_factors[:, indices],
        )
        echoes = simulate_echoes(subset, transmission, 2200, late=late, previous=previous)
        for m, k, n in iter_cells(echoes.shape, rng, 60):
            exact, size = sum_echoes_in_fifty_digits(
                subset, transmission, m, k, n, late=late, previous=previous
            )
            assert abs(echoes[m, k, n] - exact) <= tolerance * size


def test_echo_begins_at_first_sample_after_its_delay():
    transmission, n_samples = make_transmission("short", np.random.default_rng(0), n_chirps=3)
    # At 300 m/s the delay changes by 4e-3 of a sample within 7 us.
    for range_m, speed_m_per_s in [(3.3, 0), (80.0, 0), (80.0, 300), (1000.0, 300)]:
        scatterers = make_scatterers(
            transmission,
            np.random.default_rng(1),
            n=1,
            ranges_m=(1, 1),
            speed_m_per_s=speed_m_per_s,
        )
        scatterers.path_m[0] = [[range_m, 0, 0]]
        echoes = simulate_echoes(scatterers, transmission, n_samples, late="onset")
        for m, start_s in enumerate(transmission.starts_s):
            t = np.arange(n_samples) / transmission.sample_rate_hz
            position_m = scatterers.path_m[0] + np.outer(start_s + t, scatterers.path_m[1][0])
            is_present = t >= 2 * np.linalg.norm(position_m, axis=1) / SPEED_OF_LIGHT
            np.testing.assert_array_equal(echoes[m, 0] != 0, is_present)


def test_echo_lasts_as_long_as_its_ramp():
    rng = np.random.default_rng(9)
    transmission, n_samples = make_transmission("short", rng, n_chirps=2)
    gap_s, ramp_s, delay_s = 9e-6, 8e-6, 3e-6
    transmission = transmission._replace(starts_s=np.array([0, gap_s]))
    previous = PreviousRamps(np.array([np.nan, gap_s]), np.ones((2, 1), complex), ramp_s)
    scatterers = make_scatterers(transmission, rng, n=1, ranges_m=(1, 1), speed_m_per_s=0)
    scatterers.path_m[0] = [[0, delay_s * SPEED_OF_LIGHT / 2, 0]]
    echoes = simulate_echoes(scatterers, transmission, n_samples, late="tail", previous=previous)

    # The first echo ends 11 us after its ramp began, 2 us into the second ramp, whose echo begins
    # at 3 us.
    t = np.arange(n_samples) / transmission.sample_rate_hz
    np.testing.assert_array_equal(echoes[0, 0] != 0, t >= delay_s)
    np.testing.assert_array_equal(
        echoes[1, 0] != 0, (t < delay_s + ramp_s - gap_s) | (t >= delay_s)
    )
    with pytest.raises(InvalidSetting, match="^previous: missing"):
        simulate_echoes(scatterers, transmission, n_samples, late="tail")


@given(
    seed=st.integers(0, 2**32 - 1),
    waveform=st.sampled_from(list(WAVEFORMS)),
    n=st.integers(0, 70),
    n_terms=st.integers(2, 8),
    nearest_m=st.sampled_from([0.3, 3, 30]),
    speed_m_per_s=st.sampled_from([0, 1, 40, 300]),
    n_samples=st.integers(1, 300),
    late=st.sampled_from(["held", "onset"]),
)
def test_random_scenes_match_plain_sum(
    seed, waveform, n, n_terms, nearest_m, speed_m_per_s, n_samples, late
):
    rng = np.random.default_rng(seed)
    n_tx, n_rx = rng.integers(1, 4, 2)
    transmission, _ = make_transmission(waveform, rng, n_tx=n_tx, n_rx=n_rx, n_chirps=3)
    scatterers = make_scatterers(
        transmission,
        rng,
        n=n,
        ranges_m=(nearest_m, 5 * nearest_m),
        speed_m_per_s=speed_m_per_s,
        n_terms=n_terms,
        varied=bool(rng.integers(2)),
    )
    echoes = simulate_echoes(scatterers, transmission, n_samples, late=late)
    exact, sizes = sum_echoes_plainly(scatterers, transmission, n_samples, late=late)

    assert (abs(echoes - exact) <= MAX_RELATIVE_ERROR * sizes).all()


@nightly
def test_chirps_can_be_divided_among_threads():
    rng = np.random.default_rng(3)
    transmission, n_samples = make_transmission("middle", rng, n_tx=3, n_rx=4)
    scatterers = make_scatterers(
        transmission, rng, n=80, ranges_m=(2, 200), speed_m_per_s=60, varied=True
    )
    echoes = simulate_echoes(scatterers, transmission, n_samples)
    threaded_echoes = np.zeros_like(echoes)

    def add_chirps(chirps):
        add_echoes(
            threaded_echoes[chirps],
            scatterers._replace(chirp_factors=scatterers.chirp_factors[chirps]),
            transmission._replace(
                starts_s=transmission.starts_s[chirps], weights=transmission.weights[chirps]
            ),
        )

    with ThreadPoolExecutor(3) as pool:
        list(pool.map(add_chirps, [slice(0, 1), slice(1, 50), slice(50, 96, 2), slice(51, 96, 2)]))
    np.testing.assert_array_equal(threaded_echoes, echoes)


def test_echoes_are_added_to_existing_samples_and_rounded_once():
    rng = np.random.default_rng(4)
    transmission, n_samples = make_transmission("middle", rng, n_chirps=4)
    scatterers = make_scatterers(transmission, rng, n=300, ranges_m=(2, 200), speed_m_per_s=60)
    exact_echoes = simulate_echoes(scatterers, transmission, n_samples)

    np.testing.assert_array_equal(
        simulate_echoes(scatterers, transmission, n_samples, dtype=np.complex64),
        exact_echoes.astype(np.complex64),
    )
    echoes = np.ones_like(exact_echoes)
    add_echoes(echoes, scatterers, transmission)
    np.testing.assert_array_equal(echoes, 1 + exact_echoes)


def test_silent_transmitter_contributes_nothing():
    rng = np.random.default_rng(6)
    transmission, n_samples = make_transmission("middle", rng, n_tx=2, n_chirps=6)
    scatterers = make_scatterers(transmission, rng, n=5, ranges_m=(2, 200), speed_m_per_s=60)
    silent_transmission = transmission._replace(weights=transmission.weights * [0, 1])
    single_transmission = transmission._replace(
        weights=transmission.weights[:, 1:], tx_m=transmission.tx_m[1:]
    )

    np.testing.assert_array_equal(
        simulate_echoes(scatterers, silent_transmission, n_samples),
        simulate_echoes(
            scatterers._replace(tx_gains=scatterers.tx_gains[1:]), single_transmission, n_samples
        ),
    )
