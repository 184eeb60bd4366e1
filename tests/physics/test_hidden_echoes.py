"""Echoes hidden beside a strong one, compared with those that the detector finds."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.cfar.base import Cells
from dechirp.processing.hidden_echoes import (
    hidden_echo_findings,
    hidden_levels,
    unsearched_echo_findings,
)
from nightly import nightly, nightly_except
from physics.test_sidelobe_rejection import STATIC_CFAR, make_radar, simulate_tones

N_TRIALS = 12


def simulate_pair(radar, rng, *, n_cells, level_db):
    """Simulate a strong echo and another of its velocity `n_cells` behind it."""
    range_cells = 25 + rng.random() + np.array([0, n_cells])
    phases = np.exp(2j * np.pi * rng.random(2))
    cube = simulate_tones(
        radar,
        rng,
        range_cells=range_cells,
        velocity_cells=np.zeros(2),
        azimuths=np.array([0.1, 0.3]),
        amplitudes=phases * 10 ** (np.array([0, level_db]) / 20),
        snr_db=95,
    )
    return cube, range_cells[1] * radar.frame.chirp.range_resolution_m


def make_map_and_threshold(cube, radar, chain):
    power = dc.power_map(cube.isel(frame=0), radar, chain)
    return power, dc.threshold_map(power, radar, chain)


@pytest.mark.parametrize("cfar", [STATIC_CFAR, dc.Chain.cfar], ids=["velocity", "both axes"])
@pytest.mark.parametrize("n_cells", nightly_except([5], [3, 5, 8]))
def test_echoes_are_hidden_below_stated_level_and_found_above(cfar, n_cells):
    radar = make_radar()
    chain = dc.Chain(cfar=cfar).fit_to_radar(radar)
    rng = np.random.default_rng(n_cells)
    cube, _ = simulate_pair(radar, rng, n_cells=n_cells, level_db=-90)
    power, threshold = make_map_and_threshold(cube, radar, chain)
    cell = np.unravel_index(power.values.argmax(), power.shape)
    limit_db = 10 * np.log10(
        hidden_levels(power.values, threshold.values, radar, chain, cell)[n_cells - 1]
    )

    # An echo adds to the sidelobe, or takes from it: it is found from 8 dB below to 16 dB above on.
    n_found = []
    for level_db in (limit_db - 9, limit_db + 17):
        is_found = []
        for _ in range(N_TRIALS):
            cube, range_m = simulate_pair(radar, rng, n_cells=n_cells, level_db=level_db)
            found = dc.detect(cube, radar, chain)
            is_found.append(bool((abs(found.range - range_m) < 0.42).any()))
        n_found.append(sum(is_found))
    assert n_found[0] == 0 and n_found[1] >= N_TRIALS - 1


def test_finding_states_cells_and_levels_of_hidden_echoes():
    radar = make_radar()
    chain = dc.Chain(cfar=STATIC_CFAR).fit_to_radar(radar)
    cube, _ = simulate_pair(radar, np.random.default_rng(1), n_cells=5, level_db=-60)
    (finding,) = hidden_echo_findings(*make_map_and_threshold(cube, radar, chain), radar, chain)

    # Sidelobes of a Hann window: -31 dB at 3 cells, -40.4 dB at 4, -57 dB at 7, -61 dB at 8.
    assert "20 dB weaker at cells 1 to 2, 40 dB weaker at cells 1 to 3, 60 dB" in finding.value
    assert finding.level == "note"
    assert "--set chain.range_window=blackman-harris" in finding.fix
    # Proposed window: sidelobes of -92 dB, beside a main lobe of 4 cells on each side.
    sharper = replace(chain, range_window="blackman-harris")
    found = dc.detect(cube, radar, sharper)
    assert len(found.range) == 2 > len(dc.detect(cube, radar, chain).range)


@pytest.mark.parametrize(("range_cells", "max_range_cells"), [(0.3, None), (1.9, None), (25, 20)])
def test_leakage_and_echoes_beyond_the_largest_range_are_not_named(range_cells, max_range_cells):
    radar = make_radar()
    cell_m = radar.frame.chirp.range_resolution_m
    max_range_m = None if max_range_cells is None else max_range_cells * cell_m
    chain = dc.Chain(cfar=STATIC_CFAR, max_range_m=max_range_m).fit_to_radar(radar)
    cube = simulate_tones(
        radar,
        np.random.default_rng(1),
        range_cells=np.array([range_cells]),
        velocity_cells=np.zeros(1),
        azimuths=np.zeros(1),
        amplitudes=np.ones(1),
        snr_db=60,
    )
    power, threshold = make_map_and_threshold(cube, radar, chain)

    assert not hidden_echo_findings(power, threshold, radar, chain)
    if max_range_m is not None:
        (finding,) = hidden_echo_findings(power, threshold, radar, replace(chain, max_range_m=None))
        assert f"at {range_cells * cell_m:.4g} m" in finding.value


@pytest.mark.parametrize("n_chirps", [2, 64])
def test_proposed_cells_fit_the_map(n_chirps):
    radar = make_radar()
    radar = replace(radar, frame=replace(radar.frame, n_chirps=n_chirps))
    chain = dc.Chain().fit_to_radar(radar)
    cube, _ = simulate_pair(radar, np.random.default_rng(1), n_cells=5, level_db=-60)
    (finding,) = hidden_echo_findings(*make_map_and_threshold(cube, radar, chain), radar, chain)

    cells = dict(re.findall(r"chain\.cfar\.(\w+\.\w+)=(\d+)", finding.fix))
    assert bool(cells) == (n_chirps == 64)  # two velocities are too few
    if cells:
        n_training, n_guard = (
            Cells(range=int(cells[f"{name}.range"]), velocity=int(cells[f"{name}.velocity"]))
            for name in ("n_training", "n_guard")
        )
        cfar = replace(chain.cfar, n_training=n_training, n_guard=n_guard)
        assert len(dc.detect(cube, radar, replace(chain, cfar=cfar)).range) >= 1


def test_weak_echoes_give_no_finding():
    radar = make_radar()
    chain = dc.Chain(cfar=STATIC_CFAR).fit_to_radar(radar)
    cube = simulate_tones(
        radar,
        np.random.default_rng(2),
        range_cells=np.array([25.3]),
        velocity_cells=np.zeros(1),
        azimuths=np.zeros(1),
        amplitudes=np.ones(1),
        snr_db=45,
    )
    assert hidden_echo_findings(*make_map_and_threshold(cube, radar, chain), radar, chain) == ()


REAL_CHIRP = dc.Chirp(
    start_frequency_hz=77e9, slope_hz_per_s=20e12, adc_start_s=3e-6, ramp_duration_s=18e-6,
    sample_rate_hz=20e6, n_samples=256, sampling="real",
)  # fmt: skip
REAL_RADAR = dc.Radar(
    frame=dc.Frame(chirp=REAL_CHIRP, n_chirps=64, interval_s=25e-6),
    array=dc.Array(rx_m=[(0, 1.95e-3 * k, 0) for k in range(4)]),
    hardware=dc.Hardware(transmit_power_w=0.1, antenna_gain=300.0, noise_factor=10.0),
)


def run_with_target(range_cells, velocity_m_per_s, *, chain=None, rcs_m2=30.0):
    """Return the warnings of a run about unsearched cells, and ranges of detections in cells."""
    cell_m = REAL_CHIRP.range_resolution_m
    target = dc.Target(
        position_m=(range_cells * cell_m, 0, 0),
        velocity_m_per_s=(velocity_m_per_s, 0, 0),
        rcs_m2=rcs_m2,
    )
    scenario = dc.Scenario(
        radar=REAL_RADAR, scene=dc.Scene(targets=[target]), chain=chain or dc.Chain()
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        result = dc.run(scenario)
    findings = [
        finding
        for finding in result.findings
        if finding.level == "warning" and "is not detected" in finding.value
    ]
    return findings, result.detections.range.values / cell_m


# Velocities of at most one cell, 1.2 m/s, from zero or from the largest one, 38.9 m/s.
@pytest.mark.parametrize("velocity_m_per_s", nightly_except(2, [0.0, 0.3, -1.2, 38.3]))
@pytest.mark.parametrize("range_cells", [126.6, 127.0, 127.4, 127.8])
def test_unsearched_echo_at_half_the_sample_rate_is_named(range_cells, velocity_m_per_s):
    (finding,), ranges = run_with_target(range_cells, velocity_m_per_s)

    assert not ranges.size
    pattern = r"about (\S+) m with a radial speed of (\S+) m/s"
    range_m, velocity = re.search(pattern, finding.value).groups()
    cell_m = REAL_CHIRP.range_resolution_m
    # A static echo and its image, less than a main lobe apart, have one peak beside both.
    # The coupling of 38.3 m/s shifts it by 0.25 cells.
    assert float(range_m) == pytest.approx(range_cells * cell_m, abs=1.3 * cell_m)
    resolution = REAL_RADAR.frame.velocity_resolution_m_per_s
    assert float(velocity) == pytest.approx(abs(velocity_m_per_s), abs=0.6 * resolution)
    assert finding.expected == f"echoes nearer than {126.5 * cell_m:.4g} m"


@pytest.mark.parametrize("velocity_m_per_s", [0.0, 3.7, -12.0])
@pytest.mark.parametrize("range_cells", nightly_except(2, [60.3, 120.0, 125.5, 126.4]))
def test_detected_echo_and_its_image_are_not_named_as_unsearched(range_cells, velocity_m_per_s):
    findings, ranges = run_with_target(range_cells, velocity_m_per_s)

    assert not findings
    assert ranges == pytest.approx([range_cells], abs=0.05)


def test_echo_beyond_the_largest_range_of_the_chain_is_not_named_as_unsearched():
    chain = dc.Chain(max_range_m=70.0)

    assert run_with_target(127.0, 3.7, chain=chain)[0] == []


@nightly
def test_noise_at_half_the_sample_rate_is_not_named_as_echo():
    # 1 + rho times the threshold bounds the probability of each of 64 x 2 cells by 1e-6; at 1e-4,
    # 30 maps have 0.4 false alarms at most, and 9 or more with a probability below 1e-9.
    chain = dc.Chain(cfar=replace(dc.Chain.cfar, false_alarm_probability=1e-4))
    n_named = 0
    for seed in range(30):
        cube = dc.simulate(dc.Scene(), REAL_RADAR, seed=seed)
        maps = make_map_and_threshold(cube, REAL_RADAR, chain)
        n_named += len(unsearched_echo_findings(*maps, REAL_RADAR, chain, is_recorded=False))
    assert n_named < 9


def test_static_peak_at_half_the_sample_rate_of_a_recording_may_be_a_spur():
    samples = np.random.default_rng(1).normal(size=(1, 64, 4, 256)) + (-1.0) ** np.arange(256)
    cube = dc.simulate(dc.Scene(), REAL_RADAR).copy(data=samples.astype(np.float32))
    maps = make_map_and_threshold(cube, REAL_RADAR, dc.Chain())

    findings = [
        unsearched_echo_findings(*maps, REAL_RADAR, dc.Chain(), is_recorded=is_recorded)
        for is_recorded in (False, True)
    ]

    assert [finding.level for (finding,) in findings] == ["warning", "note"]
    assert "an echo or a spur of the converter, " in findings[1][0].value
