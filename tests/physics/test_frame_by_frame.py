"""Frame-by-frame simulation: equality with full cubes and independent noise."""

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.simulation.frame_by_frame import FrameSimulator
from radars import SHORT_CHIRP

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")

IMBALANCE = dc.impairments.IqImbalance(gain=1.1, phase_rad=0.03)
SCENE = dc.Scene(
    targets=[
        dc.Target(position_m=(20.0, 1.0, 0), velocity_m_per_s=(30.0, -4.0, 0), rcs_m2=10.0),
        dc.Target(position_m=(9.0, -1.0, 0), velocity_m_per_s=(0, 3.0, 0), rcs_m2=1.0),
    ]
)


def make_radar(interval_s: object = 15e-6) -> dc.Radar:
    return dc.Radar(
        frame=dc.Frame(chirp=SHORT_CHIRP, n_chirps=12, interval_s=interval_s, period_s=20e-3),
        array=dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0, 0), (0, 2e-3, 0)]),
        hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
    )


@pytest.mark.parametrize("interval_s", [15e-6, (15e-6, 17e-6)])
@pytest.mark.parametrize("impairments", [(), (IMBALANCE,)], ids=["none", "imbalance"])
def test_noise_free_frame_is_bit_identical_to_frame_of_full_cube(interval_s, impairments):
    radar = make_radar(interval_s)
    full_cube = dc.simulate(SCENE, radar, impairments=impairments, n_frames=4)
    frames = FrameSimulator(SCENE, radar, impairments=impairments, n_frames=4)
    for number in (3, 0, 2, 1):
        frame_cube = frames.simulate_frame(number, np.random.default_rng(number))
        xr.testing.assert_identical(frame_cube, full_cube.isel(frame=[number]))


def test_frame_noise_depends_on_its_generator_only():
    radar = make_radar()
    frames = FrameSimulator(SCENE, radar, n_frames=2)
    first = frames.simulate_frame(0, np.random.default_rng(7))
    xr.testing.assert_identical(first, dc.simulate(SCENE, radar, seed=7))
    second = frames.simulate_frame(1, np.random.default_rng(8))
    np.testing.assert_array_equal(second, frames.simulate_frame(1, np.random.default_rng(8)))
    assert not np.any(second.values == frames.simulate_frame(1, np.random.default_rng(9)).values)


@pytest.mark.parametrize("number", [-1, 2, 1.0])
def test_rejects_frame_number_out_of_range(number):
    frames = FrameSimulator(SCENE, make_radar(), n_frames=2)
    with pytest.raises(dc.DechirpError, match=r"number"):
        frames.simulate_frame(number, np.random.default_rng(0))
