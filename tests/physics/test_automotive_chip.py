"""Preset of an automotive 77 GHz chip: its impairments and their effect on a target."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation.adc_codes import has_adc_codes
from dechirp.simulation.impairments.automotive_chip import AutomotiveChip
from dechirp.simulation.impairments.if_filter import IfFilter
from dechirp.simulation.impairments.iq_imbalance import IqImbalance
from dechirp.simulation.stages import sort_into_stages


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    array = replace(radar.array, tx_m=[(0, 0.0156, 0)])
    return replace(radar, array=array, frame=replace(radar.frame, chirp=chirp))


def find_impairment(radar, kind):
    (impairment,) = (
        impairment
        for impairment in AutomotiveChip().impairments(radar)
        if isinstance(impairment, kind)
    )
    return impairment


def test_image_and_high_pass_match_data_sheets(radar):
    radar = set_sampling(radar, "complex")
    imbalance, high_pass = find_impairment(radar, IqImbalance), find_impairment(radar, IfFilter)
    g, phase = np.sqrt(imbalance.gain), imbalance.phase_rad
    cross = 2 * g * np.cos(phase)
    assert 10 * np.log10((1 + cross + g**2) / (1 - cross + g**2)) == pytest.approx(30, abs=0.2)
    attenuation_db = -20 * np.log10(abs(high_pass.response(np.array([350e3]))))
    assert attenuation_db.item() == pytest.approx(6, abs=0.1)


def test_real_sampling_lacks_only_iq_imbalance(radar):
    iq_impairments, real_impairments = (
        sort_into_stages([AutomotiveChip()], set_sampling(radar, sampling)).impairments
        for sampling in ("complex", "real")
    )
    assert [
        impairment for impairment in iq_impairments if not isinstance(impairment, IqImbalance)
    ] == list(real_impairments)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_target_has_true_range_velocity_and_snr(radar, sampling):
    radar = set_sampling(radar, sampling)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), velocity_m_per_s=(-5, 0, 0))])
    cube = dc.simulate(scene, radar, impairments=[AutomotiveChip()], seed=1)
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert has_adc_codes(cube)
    detections = dc.detect(cube, radar)
    nearest = detections.isel(detection=np.argmin(abs(detections.range - truth.range).values))
    for name in ("range", "velocity"):
        assert abs(nearest[name] - truth[name]).item() < 5 * nearest[f"{name}_std"].item()
    # Phase noise and quantisation of the preset are far below receiver noise; CFAR error: 1 dB.
    assert 10 * np.log10(nearest.snr.item() / truth.snr.item()) == pytest.approx(0, abs=1.5)


def test_warns_of_radar_in_another_band(radar):
    chirp = replace(radar.frame.chirp, start_frequency_hz=60e9)
    radar_60ghz = replace(radar, frame=replace(radar.frame, chirp=chirp))
    with pytest.warns(dc.PhysicsWarning, match=r"automotive-chip: a radar at 60\.3 GHz"):
        dc.simulate(dc.Scene(), radar_60ghz, impairments=[AutomotiveChip()])
