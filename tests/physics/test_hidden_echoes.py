"""Echoes hidden beside a strong one, compared with those that the detector finds."""

import re
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.cfar.base import Cells
from dechirp.processing.hidden_echoes import hidden_echo_findings, hidden_levels
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
@pytest.mark.parametrize("n_cells", [3, 5, 8])
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
