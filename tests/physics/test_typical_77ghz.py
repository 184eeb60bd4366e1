"""The preset of a 77 GHz chip: what it stands for, and what a target looks like through it."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation.adc_codes import has_adc_codes
from dechirp.simulation.impairments.if_filter import IfFilter
from dechirp.simulation.impairments.iq_imbalance import IqImbalance
from dechirp.simulation.impairments.typical_77ghz import Typical77Ghz
from dechirp.simulation.stages import sort_into_stages


def with_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    array = replace(radar.array, tx_m=[(0, 0.0156, 0)])
    return replace(radar, array=array, frame=replace(radar.frame, chirp=chirp))


def of(radar, kind):
    (one,) = (one for one in Typical77Ghz().impairments(radar) if isinstance(one, kind))
    return one


def test_its_image_and_its_high_pass_are_those_of_the_data_sheets(radar):
    radar = with_sampling(radar, "complex")
    imbalance, high_pass = of(radar, IqImbalance), of(radar, IfFilter)
    g, phase = np.sqrt(imbalance.gain), imbalance.phase_rad
    cross = 2 * g * np.cos(phase)
    assert 10 * np.log10((1 + cross + g**2) / (1 - cross + g**2)) == pytest.approx(30, abs=0.2)
    lost_db = -20 * np.log10(abs(high_pass.response(np.array([350e3]))))
    assert lost_db.item() == pytest.approx(6, abs=0.1)


def test_one_mixer_has_no_image_and_all_else_alike(radar):
    both, one = (
        sort_into_stages([Typical77Ghz()], with_sampling(radar, sampling)).impairments
        for sampling in ("complex", "real")
    )
    assert [a for a in both if not isinstance(a, IqImbalance)] == list(one)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_target_is_where_and_as_strong_as_it_should_be(radar, sampling):
    radar = with_sampling(radar, sampling)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), velocity_m_per_s=(-5, 0, 0))])
    cube = dc.simulate(scene, radar, impairments=[Typical77Ghz()], seed=1)
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert has_adc_codes(cube)
    found = dc.detect(cube, radar)
    nearest = found.isel(detection=np.argmin(abs(found.range - truth.range).values))
    for name in ("range", "velocity"):
        assert abs(nearest[name] - truth[name]).item() < 5 * nearest[f"{name}_std"].item()
    # Its phase noise and rounding are far below the noise of the receiver; CFAR is good to 1 dB.
    assert 10 * np.log10(nearest.snr.item() / truth.snr.item()) == pytest.approx(0, abs=1.5)


def test_on_another_band_it_says_so(radar):
    chirp = replace(radar.frame.chirp, start_frequency_hz=60e9)
    other = replace(radar, frame=replace(radar.frame, chirp=chirp))
    with pytest.warns(dc.PhysicsWarning, match=r"typical-77ghz: a radar at 60\.3 GHz"):
        dc.simulate(dc.Scene(), other, impairments=[Typical77Ghz()])
