"""Low-rank simulation kernel against a plain sum and the direct kernel (accurate to 1e-9)."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from beat_signal import sum_echoes_plainly
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import (
    COMMON_CASES,
    WAVEFORMS,
    make_scatterers,
    make_transmission,
    simulate_echoes,
)

from dechirp.simulation.kernels import direct, low_rank
from nightly import nightly, nightly_except


def simulate_low_rank_echoes(scatterers, transmission, n_samples, tolerance, dtype=np.complex64):
    echoes = np.zeros((len(transmission.starts_s), len(transmission.rx_m), n_samples), dtype)
    low_rank.add_echoes(echoes, scatterers, transmission, tolerance=tolerance)
    return echoes


def compute_relative_error(out, exact, sizes=None):
    """Compute the RMS error relative to the echoes, or to magnitudes that do not cancel."""
    return np.linalg.norm(out - exact) / np.linalg.norm(exact if sizes is None else sizes)


CASES = COMMON_CASES | {
    "one at 50 m": ("short", {}, {"n": 1, "ranges_m": (50, 50), "speed_m_per_s": 80}),
    "fifty": ("short", {}, {"n": 50, "ranges_m": (5, 200), "speed_m_per_s": 60}),
    "at rest": ("short", {"n_rx": 2}, {"n": 5, "ranges_m": (5, 200), "speed_m_per_s": 0}),
    "slow and long": ("long", {}, {"n": 3, "ranges_m": (1, 40), "speed_m_per_s": 1}),
    "of eight terms": (
        "long",
        {},
        {"n": 3, "ranges_m": (5, 60), "speed_m_per_s": 4, "n_terms": 8, "varied": True},
    ),
}


def make_scene(case):
    rng = np.random.default_rng(sum(map(ord, case)))
    waveform, array, targets = CASES[case]
    transmission, n_samples = make_transmission(waveform, rng, **array)
    return make_scatterers(transmission, rng, **targets), transmission, n_samples


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("tolerance", [1e-5, 1e-6])
def test_any_motion_and_array_meets_tolerance(case, tolerance):
    scatterers, transmission, n_samples = make_scene(case)
    exact = simulate_echoes(scatterers, transmission, n_samples)

    assert (
        compute_relative_error(
            simulate_low_rank_echoes(scatterers, transmission, n_samples, tolerance), exact
        )
        <= tolerance
    )


@pytest.mark.parametrize(
    "case", ["one at 50 m", "fifty", "at rest", "many at once", "slow and long"]
)
def test_ordinary_scenes_do_not_use_direct_kernel(case, monkeypatch):
    scatterers, transmission, n_samples = make_scene(case)

    def refuse(*_):
        raise AssertionError

    monkeypatch.setattr(direct, "add_echoes", refuse)
    assert simulate_low_rank_echoes(scatterers, transmission, n_samples, 1e-5).any()


@nightly
@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    waveform=st.sampled_from(list(WAVEFORMS)),
    n=st.integers(0, 50),
    n_terms=st.integers(2, 8),
    nearest_m=st.sampled_from([0.3, 3, 30]),
    speed_m_per_s=st.sampled_from([0, 1, 40, 300]),
    n_chirps=st.integers(1, 9),
    n_samples=st.integers(1, 300),
    tolerance=st.sampled_from([1e-4, 1e-5, 1e-6]),
)
def test_random_scenes_match_plain_sum(
    seed, waveform, n, n_terms, nearest_m, speed_m_per_s, n_chirps, n_samples, tolerance
):
    rng = np.random.default_rng(seed)
    n_tx, n_rx = rng.integers(1, 4, 2)
    transmission, _ = make_transmission(waveform, rng, n_tx=n_tx, n_rx=n_rx, n_chirps=n_chirps)
    transmission.weights[rng.random(transmission.weights.shape) < 0.3] = 0
    # The factor of 20 gives a long interval with large changes of range and angle.
    transmission = transmission._replace(starts_s=transmission.starts_s * rng.choice([1, 20]))
    scatterers = make_scatterers(
        transmission,
        rng,
        n=n,
        ranges_m=(nearest_m, 5 * nearest_m),
        speed_m_per_s=speed_m_per_s,
        n_terms=n_terms,
        varied=bool(rng.integers(2)),
    )
    echoes = simulate_low_rank_echoes(scatterers, transmission, n_samples, tolerance)
    exact, sizes = sum_echoes_plainly(scatterers, transmission, n_samples)

    # Echoes can cancel in few samples: the error is relative to the sum of magnitudes.
    if sizes.any():
        assert compute_relative_error(echoes, exact, sizes) <= tolerance
    else:
        assert not echoes.any()


@given(seed=st.integers(0, 2**32 - 1), n=st.sampled_from([1, 3, 20]))
@settings(max_examples=15)
def test_road_scenes_meet_tolerance(seed, n):
    rng = np.random.default_rng(seed)
    transmission, _ = make_transmission("short", rng, n_tx=2, n_rx=2)
    scatterers = make_scatterers(
        transmission, rng, n=n, ranges_m=(3, 250), speed_m_per_s=70, n_terms=3
    )
    exact = simulate_echoes(scatterers, transmission, 600)

    for tolerance in (1e-5, 1e-6):
        assert (
            compute_relative_error(
                simulate_low_rank_echoes(scatterers, transmission, 600, tolerance), exact
            )
            <= tolerance
        )


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
def test_double_precision_meets_tight_tolerance(tolerance):
    for case in ("one at 50 m", "many at once"):
        scatterers, transmission, n_samples = make_scene(case)
        exact = simulate_echoes(scatterers, transmission, n_samples)
        echoes = simulate_low_rank_echoes(scatterers, transmission, n_samples, tolerance, complex)
        assert compute_relative_error(echoes, exact) <= tolerance


@pytest.mark.parametrize("multiplexing", [[0, 1, 2], "hadamard", "silent"])
def test_transmitters_are_summed_with_their_weights(multiplexing):
    rng = np.random.default_rng(8)
    transmission, n_samples = make_transmission("middle", rng, n_tx=3, n_rx=2)
    chirps = np.arange(len(transmission.starts_s))
    if multiplexing == "hadamard":
        weights = np.array([[1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1]])[chirps % 4] + 0j
    else:
        weights = np.eye(3)[chirps % 3] + 0j
    if multiplexing == "silent":
        weights[5:40] = 0
    transmission = transmission._replace(weights=weights)
    scatterers = make_scatterers(transmission, rng, n=6, ranges_m=(2, 200), speed_m_per_s=60)
    echoes = simulate_low_rank_echoes(scatterers, transmission, n_samples, 1e-6)

    assert (
        compute_relative_error(echoes, simulate_echoes(scatterers, transmission, n_samples)) <= 1e-6
    )
    np.testing.assert_array_equal(echoes[~weights.any(axis=1)], 0)


@pytest.mark.parametrize(
    "case", nightly_except(["slow and long"], ["many at once", "slow and long", "fast and long"])
)
def test_chirps_can_be_divided_among_threads(case):
    scatterers, transmission, n_samples = make_scene(case)
    echoes = simulate_low_rank_echoes(scatterers, transmission, n_samples, 1e-5)
    threaded_echoes = np.zeros_like(echoes)

    def add_chirps(chirps):
        factors = scatterers.chirp_factors
        low_rank.add_echoes(
            threaded_echoes[chirps],
            scatterers._replace(chirp_factors=None if factors is None else factors[chirps]),
            transmission._replace(
                starts_s=transmission.starts_s[chirps], weights=transmission.weights[chirps]
            ),
        )

    with ThreadPoolExecutor(3) as pool:
        list(
            pool.map(add_chirps, [slice(0, 1), slice(1, 50), slice(50, 512, 2), slice(51, 512, 2)])
        )
    assert compute_relative_error(threaded_echoes, echoes) <= 1e-5


def test_echoes_are_added_to_existing_samples():
    scatterers, transmission, n_samples = make_scene("one at 50 m")
    echoes = np.ones((len(transmission.starts_s), 1, n_samples), np.complex64)
    low_rank.add_echoes(echoes, scatterers, transmission)

    assert (
        compute_relative_error(echoes - 1, simulate_echoes(scatterers, transmission, n_samples))
        <= 1e-5
    )
