"""The beat law and its late echoes, against waves that are sampled, mixed and low-passed.

A radar of 2 to 2.2 GHz, ramps of 10 us. The oracle leaves out the sum frequency and lets beats
up to 0.2 GHz through, each to 1e-7 by design of its low-pass (1e-8 as measured); echoes in the
kernel are held to 1e-6 of the largest. Where an echo begins or ends the low-pass takes 26 ns to
follow: those samples are left out, three in ten at most.
"""

import numpy as np
import pytest
from rf_oracle import LIGHT, TRANSIENT_S, Ramp, receive

from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.direct import PreviousRamps, add_echoes

RAMP_S, N_SAMPLES = 10e-6, 100


def radar(*, n_tx=1, n_rx=1, spacing_m=0.07, starts_s=(0.0,), weights=None, slope_hz_per_s=2e13):
    return Transmission(
        starts_s=np.array(starts_s),
        weights=np.ones((len(starts_s), n_tx)) if weights is None else weights,
        tx_m=np.arange(n_tx)[:, None] * np.array([[0.0, n_rx * spacing_m, 0.0]]),
        rx_m=np.arange(n_rx)[:, None] * np.array([[0.0, spacing_m, 0.1 * spacing_m]]),
        start_frequency_hz=2e9,
        slope_hz_per_s=slope_hz_per_s,
        adc_start_s=0.0,
        sample_rate_hz=10e6,
    )


def points(sent, *path_m, amplitudes=None):
    terms = np.array(path_m, float)
    n = terms.shape[1]
    sizes = np.linalg.norm(terms[0], axis=1) ** 2
    return Scatterers(
        path_m=terms,
        amplitudes=sizes if amplitudes is None else sizes * amplitudes,
        tx_gains=np.linspace(1, 0.5, len(sent.tx_m))[:, None] * np.ones(n),
        rx_gains=np.linspace(1, 0.7, len(sent.rx_m))[:, None] * np.ones(n),
    )


def agree(scatterers, sent, ramps, m, *, late="onset", before=None, share=0.7):
    """Compare one chirp on all receivers, but for samples near where an echo comes or goes."""
    out = np.zeros((len(sent.starts_s), len(sent.rx_m), N_SAMPLES), complex)
    add_echoes(out, scatterers, sent, late=late, previous=before)
    t = np.arange(N_SAMPLES) / sent.sample_rate_hz
    at_s = sent.starts_s[m] + t
    at_m = sum(term[:, None] * at_s[:, None] ** k for k, term in enumerate(scatterers.path_m))
    for k, rx_m in enumerate(sent.rx_m):
        settled = np.ones(N_SAMPLES, bool)
        for tx_m in sent.tx_m:
            way_m = np.linalg.norm(at_m - tx_m, axis=-1) + np.linalg.norm(at_m - rx_m, axis=-1)
            for ramp in ramps:
                since_s = at_s - way_m / LIGHT - ramp.start_s
                for edge_s in (0, ramp.duration_s):
                    settled &= (abs(since_s - edge_s) > TRANSIENT_S).all(axis=0)
        oracle = receive(scatterers, sent, ramps, m, k, N_SAMPLES)
        assert settled.mean() >= share
        largest = abs(out[m, k]).max()
        np.testing.assert_allclose(out[m, k, settled], oracle[settled], rtol=0, atol=1e-6 * largest)
        yield out[m, k], oracle, settled


@pytest.mark.parametrize("slope_hz_per_s", [2e13, -2e13])
@pytest.mark.parametrize(
    "path_m",
    [
        # Standing; at 3 km/s, by a quarter of a wavelength in a ramp; braking at 1e8 m/s^2.
        [[[9.0, 2.0, 0.0]]],
        [[[20.0, -4.0, 1.0]], [[3000.0, 500.0, 0.0]]],
        [[[40.0, 4.0, 1.0]], [[-3000.0, 0.0, 200.0]], [[5e7, 5e7, 0.0]]],
    ],
    ids=["standing", "moving", "braking"],
)
def test_a_scatterer_gives_the_beat_of_its_delayed_wave(path_m, slope_hz_per_s):
    sent = radar(slope_hz_per_s=slope_hz_per_s)
    ramps = [Ramp(0.0, RAMP_S, sent.weights[0])]
    for echo, oracle, settled in agree(points(sent, *path_m), sent, ramps, 0):
        # Silent before the echo comes, at 60 ns and more; and not afterwards.
        assert echo[0] == 0
        assert settled[0] and abs(oracle[0]) < 1e-6
        assert abs(echo[5:]).min() > 0.9


def test_transmitters_with_codes_add_up_in_the_near_field():
    codes = np.array([[1, 1j, np.exp(2j)], [0.5, -1, 0]])
    sent = radar(n_tx=3, n_rx=2, starts_s=(-15e-6, 0.0), weights=codes)
    near = points(
        sent, [[1.5, 0.4, 0.1], [5.0, -1.0, 0.3]], [[900.0, -700.0, 0.0], [0.0, 2e3, 0.0]]
    )
    for m in range(2):
        ramps = [Ramp(start_s, RAMP_S, codes[i]) for i, start_s in enumerate(sent.starts_s)]
        assert len(list(agree(near, sent, ramps, m))) == 2


def test_echoes_of_the_previous_ramp_last_into_this_one():
    gap_s, codes = 11e-6, np.array([[1j, 0.8], [1, -1]])
    sent = radar(n_tx=2, starts_s=(-gap_s, 0.0), weights=codes, spacing_m=1.0)
    before = PreviousRamps(
        gaps_s=np.array([np.nan, gap_s]),
        weights=np.array([[np.nan, np.nan], codes[0]]),
        ramp_duration_s=RAMP_S,
    )
    # Delays of 0.4, 3 and 8 us: the first is over before this ramp begins.
    far = points(
        sent,
        [[60.0, 0.0, 0.0], [300.0, 330.0, 0.0], [0.0, 1200.0, 0.0]],
        [[300.0, 0.0, 0.0], [-900.0, 0.0, 0.0], [0.0, 900.0, 0.0]],
        amplitudes=np.array([0.1, 0.5, 1.0]),
    )
    ramps = [Ramp(start_s, RAMP_S, codes[i]) for i, start_s in enumerate(sent.starts_s)]
    tail = {"late": "tail", "before": before}
    assert len(list(agree(far, sent, ramps, 0, **tail))) == 1
    ((echo, _, _),) = agree(far, sent, ramps, 1, **tail)

    # The farthest is heard until its ramp is over, 8 + 10 - 11 us into this one.
    assert abs(echo[:70]).min() > 0.1
    # Without the ramp before there is nothing until the nearest comes, at 0.4 us.
    ((echo, _, _),) = agree(far, sent, ramps[1:], 1)
    assert not echo[:4].any() and echo[6:].all()


def test_a_held_echo_is_that_of_a_ramp_begun_earlier():
    sent = radar()
    scatterers = points(sent, [[100.0, 0.0, 0.0]], [[1000.0, 300.0, 0.0]])
    out = np.zeros((1, 1, N_SAMPLES), complex)
    add_echoes(out, scatterers, sent)
    # The same line in time and frequency, drawn from 2 us before.
    early_s = 2e-6
    line = sent._replace(
        start_frequency_hz=sent.start_frequency_hz - early_s * sent.slope_hz_per_s,
        starts_s=np.array([-early_s]),
        adc_start_s=early_s,
    )
    wave = receive(scatterers, line, [Ramp(-early_s, RAMP_S + early_s, line.weights[0])], 0, 0, 100)
    np.testing.assert_allclose(out[0, 0], wave, rtol=0, atol=1e-6)
