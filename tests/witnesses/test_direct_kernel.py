"""The direct kernel against the law at 50 digits and against a plain sum of exponentials."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from beat import LIGHT, fifty_digits, plain_sum
from hypothesis import given
from hypothesis import strategies as st
from motions import MOTIONS, WAVEFORMS, scatter, send, summed

from dechirp.core.errors import InvalidSetting
from dechirp.simulation.kernels.direct import PreviousRamps, add_echoes

# Of the sum of the sizes of all echoes: what the kernel promises.
PROMISED = 1e-9


def cells(shape, rng, n_cells):
    """Random cells, and the first and the last."""
    yield 0, 0, 0
    yield tuple(axis - 1 for axis in shape)
    for _ in range(n_cells):
        yield tuple(int(rng.integers(axis)) for axis in shape)


CASES = MOTIONS | {
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
def test_any_motion_and_array_equals_fifty_digits(case):
    rng = np.random.default_rng(sum(map(ord, case)))
    waveform, array, scene = CASES[case]
    sent, n_samples = send(waveform, rng, **array)
    scatterers = scatter(sent, rng, **scene)
    out = summed(scatterers, sent, n_samples)

    for m, k, n in cells(out.shape, rng, 20):
        exact, size = fifty_digits(scatterers, sent, m, k, n)
        assert abs(out[m, k, n] - exact) <= PROMISED * size


def tail_scene(rng):
    """Echoes from 10 m to 3 km, ramps of 8 us every 9 us: some are silent, some come late."""
    sent, _ = send("short", rng, n_tx=2, n_rx=2, n_chirps=5)
    sent = sent._replace(starts_s=np.array([0.0, 9e-6, 18e-6, 27.5e-6, 36.25e-6]) - 2e-5)
    weights = np.vstack([np.full((1, 2), np.nan), sent.weights[:-1]])
    weights[2, 1] = 0
    before = PreviousRamps(
        gaps_s=np.concatenate([[np.nan], np.diff(sent.starts_s)]),
        weights=weights,
        ramp_duration_s=8e-6,
    )
    ranges_m = np.array([10.0, 50.0, 200.0, 400.0, 700.0, 1300.0])
    scatterers = scatter(sent, rng, n=len(ranges_m), ranges_m=(1, 1), speed_m_per_s=50, varied=True)
    scatterers.path_m[0] *= ranges_m[:, None]
    return scatterers._replace(amplitudes=scatterers.amplitudes * ranges_m**2), sent, before


@pytest.mark.parametrize("late", ["onset", "tail"])
def test_late_echoes_begin_and_end_as_in_fifty_digits(late):
    rng = np.random.default_rng(5)
    scatterers, sent, before = tail_scene(rng)
    # 1.3 km is 700,000 wavelengths: the range itself is rounded to 3e-9 rad.
    for only, promised in [(slice(0, 4), PROMISED), (slice(4, 6), 5e-9)]:
        some = scatterers._replace(
            path_m=scatterers.path_m[:, only],
            amplitudes=scatterers.amplitudes[only],
            tx_gains=scatterers.tx_gains[:, only],
            rx_gains=scatterers.rx_gains[:, only],
            chirp_factors=scatterers.chirp_factors[:, only],
        )
        out = summed(some, sent, 2200, late=late, previous=before)
        for m, k, n in cells(out.shape, rng, 60):
            exact, size = fifty_digits(some, sent, m, k, n, late=late, before=before)
            assert abs(out[m, k, n] - exact) <= promised * size


def test_an_echo_begins_at_the_first_sample_after_its_delay():
    sent, n_samples = send("short", np.random.default_rng(0), n_chirps=3)
    # 0 m/s and 300 m/s: in 7 us the second moves by 4e-3 of a sample.
    for range_m, speed_m_per_s in [(3.3, 0), (80.0, 0), (80.0, 300), (1000.0, 300)]:
        scatterers = scatter(
            sent, np.random.default_rng(1), n=1, ranges_m=(1, 1), speed_m_per_s=speed_m_per_s
        )
        scatterers.path_m[0] = [[range_m, 0, 0]]
        out = summed(scatterers, sent, n_samples, late="onset")
        for m, start_s in enumerate(sent.starts_s):
            t = np.arange(n_samples) / sent.sample_rate_hz
            at_m = scatterers.path_m[0] + np.outer(start_s + t, scatterers.path_m[1][0])
            present = t >= 2 * np.linalg.norm(at_m, axis=1) / LIGHT
            np.testing.assert_array_equal(out[m, 0] != 0, present)


def test_an_echo_is_in_the_air_for_as_long_as_its_ramp():
    rng = np.random.default_rng(9)
    sent, n_samples = send("short", rng, n_chirps=2)
    gap_s, ramp_s, delay_s = 9e-6, 8e-6, 3e-6
    sent = sent._replace(starts_s=np.array([0, gap_s]))
    before = PreviousRamps(np.array([np.nan, gap_s]), np.ones((2, 1), complex), ramp_s)
    scatterers = scatter(sent, rng, n=1, ranges_m=(1, 1), speed_m_per_s=0)
    scatterers.path_m[0] = [[0, delay_s * LIGHT / 2, 0]]
    out = summed(scatterers, sent, n_samples, late="tail", previous=before)

    # It ends 11 us after the first ramp began, 2 us into the second, whose echo begins at 3 us.
    t = np.arange(n_samples) / sent.sample_rate_hz
    np.testing.assert_array_equal(out[0, 0] != 0, t >= delay_s)
    np.testing.assert_array_equal(out[1, 0] != 0, (t < delay_s + ramp_s - gap_s) | (t >= delay_s))
    with pytest.raises(InvalidSetting, match="^previous: none"):
        summed(scatterers, sent, n_samples, late="tail")


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
def test_random_scenes_equal_a_plain_sum(
    seed, waveform, n, n_terms, nearest_m, speed_m_per_s, n_samples, late
):
    rng = np.random.default_rng(seed)
    n_tx, n_rx = rng.integers(1, 4, 2)
    sent, _ = send(waveform, rng, n_tx=n_tx, n_rx=n_rx, n_chirps=3)
    scatterers = scatter(
        sent,
        rng,
        n=n,
        ranges_m=(nearest_m, 5 * nearest_m),
        speed_m_per_s=speed_m_per_s,
        n_terms=n_terms,
        varied=bool(rng.integers(2)),
    )
    out = summed(scatterers, sent, n_samples, late=late)
    exact, sizes = plain_sum(scatterers, sent, n_samples, late=late)

    assert (abs(out - exact) <= PROMISED * sizes).all()


def test_chirps_may_be_shared_between_threads_in_any_parts():
    rng = np.random.default_rng(3)
    sent, n_samples = send("middle", rng, n_tx=3, n_rx=4)
    scatterers = scatter(sent, rng, n=80, ranges_m=(2, 200), speed_m_per_s=60, varied=True)
    whole = summed(scatterers, sent, n_samples)
    parts = np.zeros_like(whole)

    def some(chirps):
        add_echoes(
            parts[chirps],
            scatterers._replace(chirp_factors=scatterers.chirp_factors[chirps]),
            sent._replace(starts_s=sent.starts_s[chirps], weights=sent.weights[chirps]),
        )

    with ThreadPoolExecutor(3) as pool:
        list(pool.map(some, [slice(0, 1), slice(1, 50), slice(50, 96, 2), slice(51, 96, 2)]))
    np.testing.assert_array_equal(parts, whole)


def test_echoes_are_added_to_what_is_there_and_rounded_once():
    rng = np.random.default_rng(4)
    sent, n_samples = send("middle", rng, n_chirps=4)
    scatterers = scatter(sent, rng, n=300, ranges_m=(2, 200), speed_m_per_s=60)
    double = summed(scatterers, sent, n_samples)

    np.testing.assert_array_equal(
        summed(scatterers, sent, n_samples, dtype=np.complex64), double.astype(np.complex64)
    )
    out = np.ones_like(double)
    add_echoes(out, scatterers, sent)
    np.testing.assert_array_equal(out, 1 + double)


def test_a_silent_transmitter_is_not_heard():
    rng = np.random.default_rng(6)
    sent, n_samples = send("middle", rng, n_tx=2, n_chirps=6)
    scatterers = scatter(sent, rng, n=5, ranges_m=(2, 200), speed_m_per_s=60)
    one = sent._replace(weights=sent.weights * [0, 1])
    alone = sent._replace(weights=sent.weights[:, 1:], tx_m=sent.tx_m[1:])

    np.testing.assert_array_equal(
        summed(scatterers, one, n_samples),
        summed(scatterers._replace(tx_gains=scatterers.tx_gains[1:]), alone, n_samples),
    )
