"""Modulations with different ramps: each ramp against a plain sum of its echoes."""

from dataclasses import replace

import numpy as np
import pytest
from beat_signal import sum_echoes_plainly

import dechirp as dc
from dechirp.simulation.echo_groups import direct_echo_groups

# Start frequency and slope of each ramp, its start in the cycle, and the cycle duration.
RAMPS = {
    "triangular": ([(77e9, 20e12), (77.6e9, -20e12)], [0, 35e-6], 70e-6),
    "frequency-shift-keying": ([(76.9e9, 20e12), (77.1e9, 20e12)], [0, 35e-6], 70e-6),
    "staggered": ([(77e9, 20e12)] * 3, [0, 35e-6, 77e-6], 115e-6),
}


@pytest.mark.parametrize("fluctuation", ["steady", "swerling-2"])
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(
    "modulation",
    [
        dc.modulations.Triangular(),
        dc.modulations.FrequencyShiftKeying(step_hz=2e8),
        dc.modulations.Staggered(pauses_s=(0, 7e-6, 3e-6)),
    ],
    ids=lambda member: member.kind(),
)
def test_each_ramp_equals_plain_sum_of_its_echoes(radar, modulation, sampling, fluctuation):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    frame = replace(radar.frame, chirp=chirp, n_chirps=3, modulation=modulation)
    radar = replace(radar, frame=frame)
    targets = [
        dc.Target(position_m=(20, 3, 1), velocity_m_per_s=(-30, 5, 0), fluctuation=fluctuation),
        dc.Target(position_m=(7, -2, 0), acceleration_m_per_s2=(3, 0, 0), fluctuation=fluctuation),
    ]
    scene = dc.Scene(targets=targets)
    cube = dc.simulate(scene, radar, impairments=(), dtype=np.complex128, seed=7)
    ramps, slots_s, repetition_s = RAMPS[modulation.kind()]
    starts_s = np.array([k * repetition_s + slot_s for k in range(3) for slot_s in slots_s])
    np.testing.assert_allclose(cube.chirp, starts_s, atol=1e-15)

    expected = np.zeros((len(starts_s), 2, 256), complex)
    for echo_group in direct_echo_groups(scene, radar, 0, np.random.default_rng(7)):
        rows = range(len(starts_s))[echo_group.chirps]
        mid_s = starts_s[rows[0]] - echo_group.transmission.starts_s[0]
        for index, row in enumerate(rows):
            start_hz, slope = ramps[row % len(ramps)]
            factors = echo_group.scatterers.chirp_factors
            scatterers = echo_group.scatterers._replace(
                chirp_factors=None if factors is None else factors[index : index + 1]
            )
            transmission = echo_group.transmission._replace(
                starts_s=starts_s[row : row + 1] - mid_s,
                weights=np.ones((1, 1), complex),
                start_frequency_hz=start_hz,
                slope_hz_per_s=slope,
            )
            expected[row] += sum_echoes_plainly(scatterers, transmission, 256)[0][0]
    expected = expected if sampling == "complex" else np.sqrt(2) * expected.real
    # Specified RMS error in double precision: 1e-9 of the echoes.
    error = np.mean(abs(cube.values[0] - expected) ** 2) / np.mean(abs(expected) ** 2)
    assert np.sqrt(error) < 1e-9
