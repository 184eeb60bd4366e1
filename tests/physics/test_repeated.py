"""Many trials of one scene: each is what simulating it alone gives, to the bit."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation import monte_carlo, simulate
from dechirp.simulation.monte_carlo import MonteCarloSimulator
from radars import SHORT_CHIRP

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")


def radar_of(
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


def scene_of(*fluctuations: str) -> dc.Scene:
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


STEADY = scene_of("steady", "steady")
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
    "noise": (STEADY, radar_of(), None, 1),
    "no noise": (STEADY, radar_of(), (), 1),
    "no targets": (dc.Scene(), radar_of(), None, 2),
    "real": (STEADY, radar_of(sampling="real"), None, 1),
    "turns": (STEADY, radar_of(multiplexing=dc.multiplexing.Tdm(order=(0, 1))), None, 2),
    "frames": (STEADY, radar_of(), None, 3),
    "intervals": (STEADY, radar_of(interval_s=(15e-6, 17e-6)), None, 3),
    "white": (STEADY, radar_of(), (dc.impairments.WhiteNoise(snr=0.1, target="t1"),), 1),
    "converter": (STEADY, radar_of(), (dc.impairments.ThermalNoise(), CONVERTER), 1),
    "mixer": (
        STEADY,
        radar_of(),
        (dc.impairments.IqImbalance(gain=1.1, phase_rad=0.1), dc.impairments.ThermalNoise()),
        1,
    ),
    "filter": (STEADY, radar_of(), (dc.impairments.ThermalNoise(), dc.impairments.IfFilter()), 2),
    "leakage": (
        STEADY,
        radar_of(),
        (dc.impairments.Leakage(isolation=1e3), dc.impairments.ThermalNoise()),
        2,
    ),
    "fog-attenuation": (
        STEADY,
        radar_of(),
        (dc.impairments.FogAttenuation(water_kg_per_m3=5e-4), dc.impairments.ThermalNoise()),
        1,
    ),
    "oscillator": (STEADY, radar_of(), (PHASE_NOISE, dc.impairments.ThermalNoise()), 2),
    "interference": (STEADY, radar_of(), (INTERFERENCE, dc.impairments.ThermalNoise()), 2),
    **{
        f"swerling {kind}": (scene_of("steady", f"swerling-{kind}"), radar_of(), None, 2)
        for kind in (1, 2, 3, 4)
    },
}
RANDOM = {"oscillator", "interference"} | {name for name in CASES if "swerling" in name}


@pytest.mark.parametrize("name", CASES)
def test_trials_are_what_simulating_gives_to_the_bit(name):
    scene, radar, impairments, n_frames = CASES[name]
    trials = MonteCarloSimulator(scene, radar, impairments=impairments, n_frames=n_frames)
    ours, theirs = (np.random.default_rng(9) for _ in range(2))
    again = None
    for trial in range(4):
        # Labels and memory of an earlier trial, from the second on.
        cube = trials.simulate_trial(ours, again)
        alone = dc.simulate(scene, radar, impairments=impairments, n_frames=n_frames, seed=theirs)
        assert cube.identical(alone), trial
        assert ours.bit_generator.state == theirs.bit_generator.state
        assert again is None or cube is again
        again = cube


@pytest.mark.parametrize("name", CASES)
def test_echoes_are_summed_again_only_where_chance_is_in_them(name, monkeypatch):
    scene, radar, impairments, n_frames = CASES[name]
    trials = MonteCarloSimulator(scene, radar, impairments=impairments, n_frames=n_frames)
    summed = []

    def add_frame(*arguments: object) -> set[str]:
        summed.append(arguments)
        return frame(*arguments)

    frame = simulate._sum_frame
    monkeypatch.setattr(simulate, "_sum_frame", add_frame)
    trials.simulate_trial(np.random.default_rng(1))
    assert len(summed) == (n_frames if name in RANDOM else 0)


def test_more_than_is_kept_is_summed_again_with_the_same_bits(monkeypatch):
    scene, radar, impairments, _ = CASES["leakage"]
    kept = MonteCarloSimulator(scene, radar, impairments=impairments).simulate_trial(
        np.random.default_rng(2)
    )
    monkeypatch.setattr(monte_carlo, "MAX_CACHED_BYTES", kept.nbytes - 1)
    summed = MonteCarloSimulator(scene, radar, impairments=impairments).simulate_trial(
        np.random.default_rng(2)
    )
    assert summed.identical(kept)


def test_a_trial_leaves_the_ones_before_as_they_are():
    scene, radar, impairments, _ = CASES["converter"]
    trials = MonteCarloSimulator(scene, radar, impairments=impairments)
    first = trials.simulate_trial(np.random.default_rng(1))
    before = first.copy(deep=True)
    trials.simulate_trial(np.random.default_rng(2))
    assert first.identical(before)
    assert not (trials.simulate_trial(np.random.default_rng(2)).values == before.values).all()


def test_what_cannot_be_simulated_is_refused_before_the_first_trial():
    with pytest.raises(dc.InvalidSetting, match="target"):
        MonteCarloSimulator(
            STEADY, radar_of(), impairments=(dc.impairments.WhiteNoise(snr=1.0, target="nobody"),)
        )
