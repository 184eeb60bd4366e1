"""Compensation of target motion between transmitters, for every code and transmit order."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

import dechirp as dc
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.multiplexing.tdm import Tdm
from nightly import nightly, nightly_except
from noise_cubes import add_noise

HALF_M = 1.94e-3  # half a wavelength
TRANSMIT_ORDERS = list(permutations(range(3)))
CODES = [
    *(Tdm(order=order) for order in TRANSMIT_ORDERS),
    *(Bpm(order=order) for order in TRANSMIT_ORDERS),
    *(Ddma(order=order, n_sub_bands=4) for order in TRANSMIT_ORDERS),
    PhaseCode(phases_rad=[[0, 2.0, 0.5], [0, 2.0 + 2.0944, 0.5 + 4.1888], [0, 6.1888, 2.5944]]),
]


def make_mimo_radar(radar, code, **changes):
    """Return a radar with twelve virtual elements, 64 samples x 32 chirps each, at high power."""
    chirp = replace(radar.frame.chirp, n_samples=64)
    frame = replace(radar.frame, chirp=chirp, n_chirps=32, multiplexing=code)
    array = dc.Array(
        tx_m=[(0, 4 * HALF_M * k, 0) for k in range(3)],
        rx_m=[(0, HALF_M * k, 0) for k in range(4)],
    )
    hardware = replace(radar.hardware, transmit_power_w=100.0)
    return replace(radar, frame=frame, array=array, hardware=hardware, **changes)


def make_target(azimuth_deg, velocity_m_per_s, range_m=20.0):
    direction = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0])
    return dc.Target(
        position_m=range_m * direction, velocity_m_per_s=velocity_m_per_s * direction, rcs_m2=10
    )


def detect_strongest(radar, target):
    """Return the strongest detection and the truth of one trial."""
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    return detections.isel(detection=int(detections.snr.values.argmax())), truth


@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
@pytest.mark.parametrize(
    "code", nightly_except((CODES[2], CODES[8], CODES[14], CODES[-1]), CODES), ids=str
)
def test_angle_does_not_depend_on_velocity_for_any_transmit_order(radar, code):
    radar = make_mimo_radar(radar, code)
    max_velocity = radar.frame.max_velocity_m_per_s
    # Velocities cover the unambiguous span, and aliases as far as the chirp interval resolves them.
    for share in (-0.97, -0.5, 0.0, 0.31, 0.97, 1.4, -1.7, 2.2, -2.6):
        for azimuth_deg in (-35, 20):
            detection, truth = detect_strongest(
                radar, make_target(azimuth_deg, share * max_velocity)
            )

            assert detection.ambiguity_number.item() == round(share / 2)
            assert abs(detection.velocity - truth.velocity) < 5 * detection.velocity_std + 1e-3
            # The noise is below 0.01 degrees. Between slots the range walks by 1 mm of 1.2 m, which
            # leaves a part of the other transmitters in each channel and widens the stated error.
            error_deg = np.degrees(detection.azimuth - truth.azimuth)
            assert np.degrees(detection.azimuth_std) < 0.15
            assert abs(error_deg) < 0.1


@nightly
@pytest.mark.parametrize("code", [CODES[2], CODES[8], CODES[14]], ids=str)
def test_angle_standard_errors_of_moving_target_are_correct(radar, code):
    radar, rng = make_mimo_radar(radar, code), np.random.default_rng(2)
    scene = dc.Scene(targets=[make_target(25, -0.6 * radar.frame.max_velocity_m_per_s)])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    clean = dc.simulate(scene, radar, impairments=())
    detections = [
        dc.detect(add_noise(clean, -14, rng), radar).isel(detection=0) for _ in range(200)
    ]
    normalised_squares = [
        float((detection.azimuth - truth.azimuth) / detection.azimuth_std) ** 2
        for detection in detections
    ]

    # -14 dB per sample and 33 dB of integration gain; 5 and 6 dB more if three transmitters send in
    # all of 3 or 4 slots.
    assert 17 < 10 * np.log10(float(detections[0].snr) / 12) < 27
    # The mean of 200 squared standard normal numbers has a standard error of 10 %, five of which
    # are allowed.
    assert np.mean(normalised_squares) == pytest.approx(1, abs=0.5)
