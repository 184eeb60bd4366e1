"""The low-rank product against a plain sum and the direct kernel, which holds to 1e-9."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from beat import plain_sum
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import MOTIONS, WAVEFORMS, scatter, send, summed

from dechirp.simulation.kernels import direct, low_rank


def added(scatterers, sent, n_samples, tolerance, dtype=np.complex64):
    out = np.zeros((len(sent.starts_s), len(sent.rx_m), n_samples), dtype)
    low_rank.add_echoes(out, scatterers, sent, tolerance=tolerance)
    return out


def off(out, exact, sizes=None):
    """Root mean square error over that of the echoes, or of sizes that do not cancel."""
    return np.linalg.norm(out - exact) / np.linalg.norm(exact if sizes is None else sizes)


CASES = MOTIONS | {
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


def scene(case):
    rng = np.random.default_rng(sum(map(ord, case)))
    waveform, array, targets = CASES[case]
    sent, n_samples = send(waveform, rng, **array)
    return scatter(sent, rng, **targets), sent, n_samples


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("tolerance", [1e-5, 1e-6])
def test_any_motion_and_array_is_within_the_tolerance(case, tolerance):
    scatterers, sent, n_samples = scene(case)
    exact = summed(scatterers, sent, n_samples)

    assert off(added(scatterers, sent, n_samples, tolerance), exact) <= tolerance


@pytest.mark.parametrize(
    "case", ["one at 50 m", "fifty", "at rest", "many at once", "slow and long"]
)
def test_ordinary_scenes_are_not_left_to_the_direct_kernel(case, monkeypatch):
    scatterers, sent, n_samples = scene(case)

    def refuse(*_):
        raise AssertionError

    monkeypatch.setattr(direct, "add_echoes", refuse)
    assert added(scatterers, sent, n_samples, 1e-5).any()


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
def test_random_scenes_equal_a_plain_sum(
    seed, waveform, n, n_terms, nearest_m, speed_m_per_s, n_chirps, n_samples, tolerance
):
    rng = np.random.default_rng(seed)
    n_tx, n_rx = rng.integers(1, 4, 2)
    sent, _ = send(waveform, rng, n_tx=n_tx, n_rx=n_rx, n_chirps=n_chirps)
    sent.weights[rng.random(sent.weights.shape) < 0.3] = 0
    # A long interval too: chirps in which range and angle are quite others.
    sent = sent._replace(starts_s=sent.starts_s * rng.choice([1, 20]))
    scatterers = scatter(
        sent,
        rng,
        n=n,
        ranges_m=(nearest_m, 5 * nearest_m),
        speed_m_per_s=speed_m_per_s,
        n_terms=n_terms,
        varied=bool(rng.integers(2)),
    )
    out = added(scatterers, sent, n_samples, tolerance)
    exact, sizes = plain_sum(scatterers, sent, n_samples)

    # Few samples may be where echoes cancel: against the sum of their sizes.
    if sizes.any():
        assert off(out, exact, sizes) <= tolerance
    else:
        assert not out.any()


@given(seed=st.integers(0, 2**32 - 1), n=st.sampled_from([1, 3, 20]))
@settings(max_examples=15)
def test_scenes_on_the_road_are_within_the_tolerance(seed, n):
    rng = np.random.default_rng(seed)
    sent, _ = send("short", rng, n_tx=2, n_rx=2)
    scatterers = scatter(sent, rng, n=n, ranges_m=(3, 250), speed_m_per_s=70, n_terms=3)
    exact = summed(scatterers, sent, 600)

    for tolerance in (1e-5, 1e-6):
        assert off(added(scatterers, sent, 600, tolerance), exact) <= tolerance


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
def test_double_precision_reaches_what_single_cannot(tolerance):
    for case in ("one at 50 m", "many at once"):
        scatterers, sent, n_samples = scene(case)
        exact = summed(scatterers, sent, n_samples)
        out = added(scatterers, sent, n_samples, tolerance, complex)
        assert off(out, exact) <= tolerance


@pytest.mark.parametrize("of_each", [[0, 1, 2], "hadamard", "silent"])
def test_each_transmitter_has_its_own_weights(of_each):
    rng = np.random.default_rng(8)
    sent, n_samples = send("middle", rng, n_tx=3, n_rx=2)
    turns = np.arange(len(sent.starts_s))
    if of_each == "hadamard":
        weights = np.array([[1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1]])[turns % 4] + 0j
    else:
        weights = np.eye(3)[turns % 3] + 0j
    if of_each == "silent":
        weights[5:40] = 0
    sent = sent._replace(weights=weights)
    scatterers = scatter(sent, rng, n=6, ranges_m=(2, 200), speed_m_per_s=60)
    out = added(scatterers, sent, n_samples, 1e-6)

    assert off(out, summed(scatterers, sent, n_samples)) <= 1e-6
    np.testing.assert_array_equal(out[~weights.any(axis=1)], 0)


@pytest.mark.parametrize("case", ["many at once", "slow and long", "fast and long"])
def test_chirps_may_be_shared_between_threads_in_any_parts(case):
    scatterers, sent, n_samples = scene(case)
    whole = added(scatterers, sent, n_samples, 1e-5)
    parts = np.zeros_like(whole)

    def some(chirps):
        factors = scatterers.chirp_factors
        low_rank.add_echoes(
            parts[chirps],
            scatterers._replace(chirp_factors=None if factors is None else factors[chirps]),
            sent._replace(starts_s=sent.starts_s[chirps], weights=sent.weights[chirps]),
        )

    with ThreadPoolExecutor(3) as pool:
        list(pool.map(some, [slice(0, 1), slice(1, 50), slice(50, 512, 2), slice(51, 512, 2)]))
    assert off(parts, whole) <= 1e-5


def test_echoes_are_added_to_what_is_there():
    scatterers, sent, n_samples = scene("one at 50 m")
    out = np.ones((len(sent.starts_s), 1, n_samples), np.complex64)
    low_rank.add_echoes(out, scatterers, sent)

    assert off(out - 1, summed(scatterers, sent, n_samples)) <= 1e-5
