"""Breathing in halves of recordings, and none in a recorded scene without a person."""

import numpy as np
import pytest
from real_recordings import open_real_recording

import dechirp as dc
from dechirp.processing.slow_time import range_traces
from dechirp.processing.vital_signs import VitalSigns, measure_vital_signs
from dechirp.recordings.slow_time_files import read_slow_time
from nightly import nightly

TOLERANCE_HZ = 1 / 60  # a third of the resolution of 20 s


@nightly
@pytest.mark.parametrize("half", [0, 1])
def test_each_half_of_a_recording_has_its_breathing_rate(witness_data, half):
    """The rule that withdraws contradicting rates was found with another recording."""
    trace = read_slow_time(
        witness_data / "breathing_27bpm" / "data_27bpm_20Hz.csv", wavelength_m=5e-3
    )
    middle = trace.sizes["time"] // 2
    vital = measure_vital_signs(trace[middle:] if half else trace[:middle])
    assert vital.sizes["window"] == 4
    np.testing.assert_allclose(vital.breathing_rate, 27 / 60, atol=TOLERANCE_HZ)


@nightly
@pytest.mark.parametrize("half", [0, 1])
def test_each_half_of_the_recording_of_a_moving_person_has_one_rate(witness_data, half):
    """No window of either half has a rate that differs from the others by more than a resolution.

    The rule was found with the whole recording, whose windows begin at other times.
    """
    trace = read_slow_time(witness_data / "breathing_27bpm" / "br1.csv", wavelength_m=5e-3)
    middle = trace.sizes["time"] // 2
    rates = measure_vital_signs(trace[middle:] if half else trace[:middle]).breathing_rate
    assert rates.notnull().any()
    assert float(rates.max() - rates.min()) <= 1 / 20


def test_two_reflectors_have_no_vital_signs(real_data):
    """A recording of 5 s contains two periods of rates from 0.45 Hz on."""
    recording = open_real_recording(real_data / "bgt60_two_reflectors", "RadarIfxAvian_00")
    traces = range_traces(recording.cube, recording.radar, (0.2, 0.87))
    vital = measure_vital_signs(traces, VitalSigns(window_s=4.7, breathing_hz=(0.45, 0.79)))
    assert vital.sizes["window"] == 1
    assert vital.breathing_rate.isnull().all() and vital.heart_rate.isnull().all()


def test_trolley_has_no_breathing(witness_data):
    """A trolley that is pulled through 12 s moves, but not as breathing."""
    recording = dc.open(witness_data / "urad_sweeps" / "IQ_0_1024_sweeps.txt")
    vital = measure_vital_signs(range_traces(recording.cube, recording.radar, (2.0, 60.0)))
    assert vital.breathing_rate.isnull().all()
