"""Monte Carlo simulator: trials equal single simulations bit by bit."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation import monte_carlo, simulate
from dechirp.simulation.monte_carlo import MonteCarloSimulator
from nightly import nightly_except
from radars import SHORT_CHIRP

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")


def build_radar(
    *,
    sampling: str = "complex",
    multiplexing: dc.multiplexing.Tdm | None = None,
    interval_s: object = 15e-6,
) -> dc.Radar:
    return dc.Radar(
        frame=dc.Frame(
            chirp=replace(SHORT_CHIRP, sampling=sampling),
            n_chirps=12,
            interval_s=interval_s,
            period_s=1e-3,
            multiplexing=multiplexing,
        ),
        array=dc.Array(
            tx_m=[(0, 0, 0), (0, 4e-3, 0)] if multiplexing else [(0, 0, 0)],
            rx_m=[(0, 0, 0), (0, 2e-3, 0)],
        ),
        hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
    )


def build_scene(*fluctuations: str) -> dc.Scene:
    return dc.Scene(
        targets=[
            dc.Target(
                name=f"t{i}",
                position_m=(20.0 + 9 * i, 1.0, 0),
                velocity_m_per_s=(3.0, 0, 0),
                rcs_m2=10.0,
                fluctuation=fluctuation,
            )
            for i, fluctuation in enumerate(fluctuations)
        ]
    )


STEADY_SCENE = build_scene("steady", "steady")
PHASE_NOISE = dc.impairments.PhaseNoise(offset_hz=(1e4, 1e5, 1e6), level_per_hz=(1e-7, 1e-9, 1e-11))
INTERFERENCE = dc.impairments.Interference(
    interferers=(
        dc.impairments.Interferer(
            position_m=(30.0, 1.0, 0.0),
            start_frequency_hz=76.9e9,
            slope_hz_per_s=-20e12,
            ramp_duration_s=20e-6,
            interval_s=25e-6,
            transmit_power_w=0.01,
            antenna_gain=10.0,
        ),
    )
)
CONVERTER = dc.impairments.Quantisation(bits=8, full_scale_w=1e-9)
CASES = {
    "noise": (STEADY_SCENE, build_radar(), None, 1),
    "no noise": (STEADY_SCENE, build_radar(), (), 1),
    "no targets": (dc.Scene(), build_radar(), None, 2),
    "real": (STEADY_SCENE, build_radar(sampling="real"), None, 1),
    "tdm": (STEADY_SCENE, build_radar(multiplexing=dc.multiplexing.Tdm(order=(0, 1))), None, 2),
    "frames": (STEADY_SCENE, build_radar(), None, 3),
    "intervals": (STEADY_SCENE, build_radar(interval_s=(15e-6, 17e-6)), None, 3),
    "white noise": (
        STEADY_SCENE,
        build_radar(),
        (dc.impairments.WhiteNoise(snr=0.1, target="t1"),),
        1,
    ),
    "converter": (STEADY_SCENE, build_radar(), (dc.impairments.ThermalNoise(), CONVERTER), 1),
    "mixer": (
        STEADY_SCENE,
        build_radar(),
        (dc.impairments.IqImbalance(gain=1.1, phase_rad=0.1), dc.impairments.ThermalNoise()),
        1,
    ),
    "filter": (
        STEADY_SCENE,
        build_radar(),
        (dc.impairments.ThermalNoise(), dc.impairments.IfFilter()),
        2,
    ),
    "leakage": (
        STEADY_SCENE,
        build_radar(),
        (dc.impairments.Leakage(isolation=1e3), dc.impairments.ThermalNoise()),
        2,
    ),
    "fog-attenuation": (
        STEADY_SCENE,
        build_radar(),
        (dc.impairments.FogAttenuation(water_kg_per_m3=5e-4), dc.impairments.ThermalNoise()),
        1,
    ),
    "oscillator": (STEADY_SCENE, build_radar(), (PHASE_NOISE, dc.impairments.ThermalNoise()), 2),
    "interference": (STEADY_SCENE, build_radar(), (INTERFERENCE, dc.impairments.ThermalNoise()), 2),
    **{
        f"swerling {kind}": (build_scene("steady", f"swerling-{kind}"), build_radar(), None, 2)
        for kind in (1, 2, 3, 4)
    },
}
RANDOM_CASES = {"oscillator", "interference"} | {name for name in CASES if "swerling" in name}


@pytest.mark.parametrize(
    "name",
    nightly_except(("noise", "tdm", "intervals", "converter", "oscillator", "swerling 1"), CASES),
)
def test_trials_equal_single_simulations_bit_by_bit(name):
    scene, radar, impairments, n_frames = CASES[name]
    simulator = MonteCarloSimulator(scene, radar, impairments=impairments, n_frames=n_frames)
    trial_rng, simulation_rng = (np.random.default_rng(9) for _ in range(2))
    cube_memory = None
    for trial in range(4):
        # From the second trial on, labels and memory of the previous cube are reused.
        cube = simulator.simulate_trial(trial_rng, cube_memory)
        expected = dc.simulate(
            scene, radar, impairments=impairments, n_frames=n_frames, seed=simulation_rng
        )
        assert cube.identical(expected), trial
        assert trial_rng.bit_generator.state == simulation_rng.bit_generator.state
        assert cube_memory is None or cube is cube_memory
        cube_memory = cube


@pytest.mark.parametrize("name", CASES)
def test_only_random_echoes_are_summed_again_in_each_trial(name, monkeypatch):
    scene, radar, impairments, n_frames = CASES[name]
    simulator = MonteCarloSimulator(scene, radar, impairments=impairments, n_frames=n_frames)
    calls = []

    def add_frame(*arguments: object) -> set[str]:
        calls.append(arguments)
        return sum_frame(*arguments)

    sum_frame = simulate._sum_frame_signals
    monkeypatch.setattr(simulate, "_sum_frame_signals", add_frame)
    simulator.simulate_trial(np.random.default_rng(1))
    assert len(calls) == (n_frames if name in RANDOM_CASES else 0)


def test_trials_beyond_cache_limit_are_identical(monkeypatch):
    scene, radar, impairments, _ = CASES["leakage"]
    cached_cube = MonteCarloSimulator(scene, radar, impairments=impairments).simulate_trial(
        np.random.default_rng(2)
    )
    monkeypatch.setattr(monte_carlo, "MAX_CACHED_BYTES", cached_cube.nbytes - 1)
    recomputed_cube = MonteCarloSimulator(scene, radar, impairments=impairments).simulate_trial(
        np.random.default_rng(2)
    )
    assert recomputed_cube.identical(cached_cube)


def test_trial_does_not_change_earlier_cubes():
    scene, radar, impairments, _ = CASES["converter"]
    simulator = MonteCarloSimulator(scene, radar, impairments=impairments)
    first_cube = simulator.simulate_trial(np.random.default_rng(1))
    first_copy = first_cube.copy(deep=True)
    simulator.simulate_trial(np.random.default_rng(2))
    assert first_cube.identical(first_copy)
    assert not (
        simulator.simulate_trial(np.random.default_rng(2)).values == first_copy.values
    ).all()


def test_rejects_invalid_impairment_before_first_trial():
    with pytest.raises(dc.InvalidSetting, match="target"):
        MonteCarloSimulator(
            STEADY_SCENE,
            build_radar(),
            impairments=(dc.impairments.WhiteNoise(snr=1.0, target="nobody"),),
        )
