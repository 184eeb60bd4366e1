"""A twin of a real recording has its noise and its peaks, after the same chain, with noise."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.experiments.twin.twin import TwinTolerance
from recordings.opened import opened

RECORDINGS = [
    # The last: how many peaks the noise lets judge, at least.
    ("openradar_people", "simple_frame_1.npy", 22),
    ("openradar_people", "doppler_example_1.npy", 30),
    ("bgt60_two_reflectors", "RadarIfxAvian_00", 4),
]


@pytest.mark.parametrize(("folder", "name", "n_judged"), RECORDINGS)
def test_noise_and_peaks_are_within_1_db_and_a_fifth_of_a_bin(real_data, folder, name, n_judged):
    made = dc.twin(opened(real_data / folder, name), seed=20)

    found = made.differences
    judged = made.judged_peaks(TwinTolerance())
    assert judged.sum() >= n_judged
    assert abs(to_decibels(made.noise.ratio)) < 1
    assert np.all(abs(to_decibels(found.power_ratio))[judged] < 1)
    assert np.all(abs(found.range_cells)[judged] < 0.2)
    assert np.all(abs(found.velocity_cells)[judged] < 0.2)
    # The points give the peaks themselves; what is left is the noise of the twin.
    assert np.all(made.peaks_within_clean(TwinTolerance()))
    assert np.all(abs(to_decibels(found.power_ratio_clean))[judged] < 0.1)
    off = to_decibels(found.power_ratio)[judged] / (4.34 * found.power_std[judged])
    weak = found.snr[judged].values < 1e3
    if weak.sum() > 3:
        assert np.sqrt(np.mean(off.values[weak] ** 2)) < 2


def test_the_strongest_peak_of_thousands_of_ramps_is_within_the_bar(real_data):
    made = dc.twin(opened(real_data / "sirad122_walk", "giulioCammina.json"), max_peaks=1)

    assert made.peaks_within_clean(TwinTolerance()).tolist() == [True]
    assert made.scenario.chain.cfar.n_training.velocity == 500


def test_two_reflectors_are_the_strongest_targets_of_their_twin(real_data):
    made = dc.twin(opened(real_data / "bgt60_two_reflectors", "RadarIfxAvian_00"))

    # 0.300 m and 0.457 m by the script of the collection, 6.2 dB apart.
    first, second = (made.differences.isel(peak=place) for place in (0, 1))
    assert float(first.range) == pytest.approx(0.300, abs=0.01)
    assert float(second.range) == pytest.approx(0.457, abs=0.01)
    assert float(to_decibels(first.power / second.power)) == pytest.approx(6.2, abs=0.5)
    kinds = [one.kind() for one in made.scenario.impairments]
    assert kinds == ["leakage", "dc-offset", "coloured-noise"]
