"""Motion turns the transmitters against each other: undone, whatever their order."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

import dechirp as dc
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.multiplexing.tdm import Tdm
from noise import noisy

HALF_M = 1.94e-3  # half a wavelength
ORDERS = list(permutations(range(3)))
CODES = [
    *(Tdm(order=order) for order in ORDERS),
    *(Bpm(order=order) for order in ORDERS),
    *(Ddma(order=order, n_sub_bands=4) for order in ORDERS),
    PhaseCode(phases_rad=[[0, 2.0, 0.5], [0, 2.0 + 2.0944, 0.5 + 4.1888], [0, 6.1888, 2.5944]]),
]


def mimo(radar, code, **changes):
    """Twelve virtual elements in a row, 64 samples x 32 chirps of each, loud."""
    chirp = replace(radar.frame.chirp, n_samples=64)
    frame = replace(radar.frame, chirp=chirp, n_chirps=32, multiplexing=code)
    array = dc.Array(
        tx_m=[(0, 4 * HALF_M * k, 0) for k in range(3)],
        rx_m=[(0, HALF_M * k, 0) for k in range(4)],
    )
    hardware = replace(radar.hardware, transmit_power_w=100.0)
    return replace(radar, frame=frame, array=array, hardware=hardware, **changes)


def at(azimuth_deg, velocity_m_per_s, range_m=20.0):
    towards = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0])
    return dc.Target(
        position_m=range_m * towards, velocity_m_per_s=velocity_m_per_s * towards, rcs_m2=10
    )


def seen(radar, target):
    """The strongest detection and the truth, of one look."""
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    return found.isel(detection=int(found.snr.values.argmax())), truth


@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
@pytest.mark.parametrize("code", CODES, ids=str)
def test_angles_do_not_depend_on_velocity_in_any_order(radar, code):
    radar = mimo(radar, code)
    most = radar.frame.max_velocity_m_per_s
    # All of the span of the map, and what folds onto it: as far as the interval tells.
    for share in (-0.97, -0.5, 0.0, 0.31, 0.97, 1.4, -1.7, 2.2, -2.6):
        for azimuth_deg in (-35, 20):
            found, truth = seen(radar, at(azimuth_deg, share * most))

            assert found.ambiguity_number.item() == round(share / 2)
            assert abs(found.velocity - truth.velocity) < 5 * found.velocity_std + 1e-3
            # 0.03 degrees of noise, five of them. Between slots the range walks by 1 mm of 1.2 m.
            error_deg = np.degrees(found.azimuth - truth.azimuth)
            assert np.degrees(found.azimuth_std) < 0.01
            assert abs(error_deg) < 0.1


@pytest.mark.parametrize("code", [CODES[2], CODES[8], CODES[14]], ids=str)
def test_angle_errors_are_as_their_standard_errors_say(radar, code):
    radar, rng = mimo(radar, code), np.random.default_rng(2)
    scene = dc.Scene(targets=[at(25, -0.6 * radar.frame.max_velocity_m_per_s)])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    clean = dc.simulate(scene, radar, impairments=())
    found = [dc.detect(noisy(clean, -14, rng), radar).isel(detection=0) for _ in range(200)]
    square = [float((one.azimuth - truth.azimuth) / one.azimuth_std) ** 2 for one in found]

    # -14 dB, 33 dB of gain; 5 and 6 dB more where three transmitters send in all of 3 or 4 slots.
    assert 17 < 10 * np.log10(float(found[0].snr) / 12) < 27
    # The mean of 200 squares of unit normal numbers: 10 % each, five of them.
    assert np.mean(square) == pytest.approx(1, abs=0.5)
