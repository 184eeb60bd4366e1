"""Beat signals and late echoes against sampled, mixed and low-pass filtered waves.

The radar sweeps 2 to 2.2 GHz in ramps of 10 us. The low-pass filter of the oracle removes the sum
frequency and passes beat frequencies up to 0.2 GHz, each to 1e-7 by design (1e-8 measured). Echoes
of the kernel must agree within 1e-6 of the largest. The filter settles within 26 ns after an echo
begins or ends: those samples are excluded, at most three in ten.
"""

import numpy as np
import pytest
from rf_oracle import SPEED_OF_LIGHT, TRANSIENT_S, Ramp, simulate_received_samples

from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.direct import PreviousRamps, add_echoes

RAMP_S, N_SAMPLES = 10e-6, 100


def make_transmission(
    *, n_tx=1, n_rx=1, spacing_m=0.07, starts_s=(0.0,), weights=None, slope_hz_per_s=2e13
):
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


def make_scatterers(transmission, *path_m, amplitudes=None):
    terms = np.array(path_m, float)
    n = terms.shape[1]
    sizes = np.linalg.norm(terms[0], axis=1) ** 2
    return Scatterers(
        path_m=terms,
        amplitudes=sizes if amplitudes is None else sizes * amplitudes,
        tx_gains=np.linspace(1, 0.5, len(transmission.tx_m))[:, None] * np.ones(n),
        rx_gains=np.linspace(1, 0.7, len(transmission.rx_m))[:, None] * np.ones(n),
    )


def compare_with_oracle(
    scatterers, transmission, ramps, m, *, late="onset", previous=None, min_settled_fraction=0.7
):
    """Compare one chirp on all receivers, except samples near the start or end of an echo."""
    out = np.zeros((len(transmission.starts_s), len(transmission.rx_m), N_SAMPLES), complex)
    add_echoes(out, scatterers, transmission, late=late, previous=previous)
    t = np.arange(N_SAMPLES) / transmission.sample_rate_hz
    time_s = transmission.starts_s[m] + t
    position_m = sum(
        term[:, None] * time_s[:, None] ** k for k, term in enumerate(scatterers.path_m)
    )
    for k, rx_m in enumerate(transmission.rx_m):
        is_settled = np.ones(N_SAMPLES, bool)
        for tx_m in transmission.tx_m:
            path_length_m = np.linalg.norm(position_m - tx_m, axis=-1) + np.linalg.norm(
                position_m - rx_m, axis=-1
            )
            for ramp in ramps:
                since_s = time_s - path_length_m / SPEED_OF_LIGHT - ramp.start_s
                for edge_s in (0, ramp.duration_s):
                    is_settled &= (abs(since_s - edge_s) > TRANSIENT_S).all(axis=0)
        oracle = simulate_received_samples(scatterers, transmission, ramps, m, k, N_SAMPLES)
        assert is_settled.mean() >= min_settled_fraction
        largest = abs(out[m, k]).max()
        np.testing.assert_allclose(
            out[m, k, is_settled], oracle[is_settled], rtol=0, atol=1e-6 * largest
        )
        yield out[m, k], oracle, is_settled


@pytest.mark.parametrize("slope_hz_per_s", [2e13, -2e13])
@pytest.mark.parametrize(
    "path_m",
    [
        # Static; 3 km/s, a quarter of a wavelength per ramp; braking at 1e8 m/s^2.
        [[[9.0, 2.0, 0.0]]],
        [[[20.0, -4.0, 1.0]], [[3000.0, 500.0, 0.0]]],
        [[[40.0, 4.0, 1.0]], [[-3000.0, 0.0, 200.0]], [[5e7, 5e7, 0.0]]],
    ],
    ids=["standing", "moving", "braking"],
)
def test_scatterer_gives_beat_of_its_delayed_wave(path_m, slope_hz_per_s):
    transmission = make_transmission(slope_hz_per_s=slope_hz_per_s)
    ramps = [Ramp(0.0, RAMP_S, transmission.weights[0])]
    for echo, oracle, is_settled in compare_with_oracle(
        make_scatterers(transmission, *path_m), transmission, ramps, 0
    ):
        # Samples are zero before the echo arrives, at 60 ns or later, and nonzero afterwards.
        assert echo[0] == 0
        assert is_settled[0] and abs(oracle[0]) < 1e-6
        assert abs(echo[5:]).min() > 0.9


def test_coded_transmitters_are_summed_in_near_field():
    codes = np.array([[1, 1j, np.exp(2j)], [0.5, -1, 0]])
    transmission = make_transmission(n_tx=3, n_rx=2, starts_s=(-15e-6, 0.0), weights=codes)
    scatterers = make_scatterers(
        transmission, [[1.5, 0.4, 0.1], [5.0, -1.0, 0.3]], [[900.0, -700.0, 0.0], [0.0, 2e3, 0.0]]
    )
    for m in range(2):
        ramps = [Ramp(start_s, RAMP_S, codes[i]) for i, start_s in enumerate(transmission.starts_s)]
        assert len(list(compare_with_oracle(scatterers, transmission, ramps, m))) == 2


def test_echoes_of_previous_ramp_last_into_next_one():
    gap_s, codes = 11e-6, np.array([[1j, 0.8], [1, -1]])
    transmission = make_transmission(n_tx=2, starts_s=(-gap_s, 0.0), weights=codes, spacing_m=1.0)
    previous = PreviousRamps(
        gaps_s=np.array([np.nan, gap_s]),
        weights=np.array([[np.nan, np.nan], codes[0]]),
        ramp_duration_s=RAMP_S,
    )
    # Delays of 0.4, 3 and 8 us: the first echo ends before this ramp begins.
    scatterers = make_scatterers(
        transmission,
        [[60.0, 0.0, 0.0], [300.0, 330.0, 0.0], [0.0, 1200.0, 0.0]],
        [[300.0, 0.0, 0.0], [-900.0, 0.0, 0.0], [0.0, 900.0, 0.0]],
        amplitudes=np.array([0.1, 0.5, 1.0]),
    )
    ramps = [Ramp(start_s, RAMP_S, codes[i]) for i, start_s in enumerate(transmission.starts_s)]
    tail = {"late": "tail", "previous": previous}
    assert len(list(compare_with_oracle(scatterers, transmission, ramps, 0, **tail))) == 1
    ((echo, _, _),) = compare_with_oracle(scatterers, transmission, ramps, 1, **tail)

    # The farthest echo lasts until 8 + 10 - 11 us into this ramp.
    assert abs(echo[:70]).min() > 0.1
    # Without the previous ramp, samples are zero until the nearest echo arrives at 0.4 us.
    ((echo, _, _),) = compare_with_oracle(scatterers, transmission, ramps[1:], 1)
    assert not echo[:4].any() and echo[6:].all()


def test_held_echo_equals_echo_of_ramp_started_earlier():
    transmission = make_transmission()
    scatterers = make_scatterers(transmission, [[100.0, 0.0, 0.0]], [[1000.0, 300.0, 0.0]])
    out = np.zeros((1, 1, N_SAMPLES), complex)
    add_echoes(out, scatterers, transmission)
    # The same line in time and frequency, started 2 us earlier.
    early_s = 2e-6
    early_transmission = transmission._replace(
        start_frequency_hz=transmission.start_frequency_hz - early_s * transmission.slope_hz_per_s,
        starts_s=np.array([-early_s]),
        adc_start_s=early_s,
    )
    wave = simulate_received_samples(
        scatterers,
        early_transmission,
        [Ramp(-early_s, RAMP_S + early_s, early_transmission.weights[0])],
        0,
        0,
        100,
    )
    np.testing.assert_allclose(out[0, 0], wave, rtol=0, atol=1e-6)
