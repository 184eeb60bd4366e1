"""Detections that are drawn from theory, beside those of samples."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning
from dechirp.evaluation.association import Associator
from dechirp.experiments.link_budget import added_noise_w
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.experiments.statistical.sensor import StatisticalSensor, sense
from dechirp.processing.cfar.base import Cells, Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.cfar.ordered_statistic import OrderedStatistic
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect_columns
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.simulation.impairments.rain_attenuation import RainAttenuation
from dechirp.simulation.impairments.thermal_noise import ThermalNoise
from dechirp.simulation.impairments.typical_77ghz import Typical77Ghz
from nightly import nightly

PLACES = [(18.0, -20.0), (18.5, 12.25), (50.25, -20.5), (50.0, 12.4), (83.3, -20.3), (83.75, 12.0)]
ERRORS = ("range_error_m", "velocity_error_m_per_s", "azimuth_error_rad")
STDS = ("range_std", "velocity_std", "azimuth_std")


def radar_of(n_elements):
    """64 chirps of 112 samples; with 8 elements two transmitters in turns and four receivers."""
    half_m = 1.95e-3
    chirp = Chirp(
        start_frequency_hz=76.5e9, slope_hz_per_s=20e12, adc_start_s=2e-6, ramp_duration_s=12e-6,
        sample_rate_hz=12.8e6, n_samples=112, sampling="complex",
    )  # fmt: skip
    turns = Tdm(order=(0, 1)) if n_elements > 1 else None
    n_rx = max(n_elements // 2, 1)
    array = Array(
        tx_m=tuple((0.0, k * n_rx * half_m, 0.0) for k in range(1 + (turns is not None))),
        rx_m=tuple((0.0, k * half_m, 0.0) for k in range(n_rx)),
    )
    return Radar(
        frame=Frame(chirp=chirp, n_chirps=64, interval_s=15e-6, multiplexing=turns),
        array=array,
        hardware=Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
    )


def scenario_of(radar, places=PLACES, snr_db=16.0, fluctuation="steady", pfa=1e-5, **chain):
    """Targets of one ratio at places in cells, each in a direction of its own."""
    frame, targets = radar.frame, []
    for row, (in_range, in_velocity) in enumerate(places):
        azimuth = np.radians(8.0 * row - 20)
        towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        velocity = in_velocity * frame.velocity_resolution_m_per_s
        range_m = in_range * frame.chirp.range_resolution_m
        range_m -= frame.chirp.range_doppler_coupling_m(velocity)
        target = dc.Target(
            position_m=tuple(range_m * towards), velocity_m_per_s=tuple(velocity * towards)
        )
        now = float(dc.truth(dc.Scene(targets=(target,)), radar).snr[0, 0])
        rcs_m2 = 10 ** (snr_db / 10) / now
        targets.append(replace(target, rcs_m2=rcs_m2, fluctuation=fluctuation))
    cfar = Cfar(
        estimator=chain.pop("estimator", CellAveraging()), n_training=Cells(range=8, velocity=6),
        n_guard=Cells(range=3, velocity=3), false_alarm_probability=pfa,
        offset=chain.pop("offset", None),
    )  # fmt: skip
    return Scenario(
        radar=radar, scene=dc.Scene(targets=tuple(targets)), chain=Chain(cfar=cfar, **chain)
    )


def score(scenario, frame, n_trials):
    """Share of targets found, false alarms in a frame, errors (3, n) and stated ones (3, n)."""
    noise_w = added_noise_w(scenario, scenario.radar)
    truth = dc.truth(scenario.scene, scenario.radar, noise_power_w=noise_w)
    matched, found, false, errors, stds = Associator(truth, scenario.radar), 0, 0, [], []
    for _ in range(n_trials):
        columns = frame()
        match = matched(columns)
        near = match.target >= 0
        found += len(np.unique(match.target[near]))
        false += np.sum(~near)
        errors.append(np.array([getattr(match, name) for name in ERRORS])[:, near])
        stds.append(np.array([columns[name] for name in STDS])[:, near])
    errors, stds = np.concatenate(errors, axis=1), np.concatenate(stds, axis=1)
    # A false alarm within two cells of a target counts as its detection, and one refinement in
    # 100 under a rectangular window ends on a wrong hill: neither is an estimate of these laws.
    own = ~np.any(abs(errors) > 6 * np.median(stds, axis=1, keepdims=True), axis=0)
    n = n_trials * len(scenario.scene.targets)
    return found / max(n, 1), false / n_trials, errors[:, own], stds[:, own]


def of_samples(scenario, seed):
    rng, chain = np.random.default_rng(seed), scenario.chain.fit_to_radar(scenario.radar)

    def frame():
        cube = dc.simulate(scenario.scene, scenario.radar, seed=rng)
        return detect_columns([cube], scenario.radar, chain)

    return frame


def drawn(scenario, seed):
    sensor, rng = StatisticalSensor(scenario), np.random.default_rng(seed)
    return lambda: sensor.detections(rng)


def rms(errors):
    return np.sqrt(np.mean(errors**2, axis=1))


def agree(scenario, n_trials, *, within, rms_within):
    """Both scores, after a check that they differ by no more than that and five errors."""
    one = score(scenario, of_samples(scenario, 1), n_trials)
    two = score(scenario, drawn(scenario, 2), n_trials)
    share = (one[0] + two[0]) / 2
    n = n_trials * len(scenario.scene.targets)
    assert abs(one[0] - two[0]) <= within + 5 * np.sqrt(2 * share * (1 - share) / n)
    for first, second in zip(rms(one[2]), rms(two[2]), strict=True):
        if np.isfinite(first):
            assert abs(second / first - 1) <= rms_within + 5 / np.sqrt(one[2].shape[1])


# 600 targets: five standard errors of the difference are 0.14 at the most.
@pytest.mark.parametrize(("n_elements", "fluctuation"), [(1, "steady"), (8, "swerling-1")])
def test_as_many_targets_are_found_as_in_samples_and_as_exactly(n_elements, fluctuation):
    snr_db = 16.0 if n_elements == 1 else 17.5
    scenario = scenario_of(radar_of(n_elements), snr_db=snr_db, fluctuation=fluctuation)
    agree(scenario, 100, within=0.0, rms_within=0.0)


@nightly
@pytest.mark.parametrize("n_elements", [1, 8])
@pytest.mark.parametrize("fluctuation", ["steady", "swerling-1"])
@pytest.mark.parametrize("more_db", [-2, 0, 1.5, 5])
def test_probabilities_agree_within_002_and_errors_within_a_tenth(n_elements, fluctuation, more_db):
    snr_db = (16.0 if n_elements == 1 else 17.5) + more_db
    scenario = scenario_of(radar_of(n_elements), snr_db=snr_db, fluctuation=fluctuation)
    one = score(scenario, of_samples(scenario, 1), 2000)
    two = score(scenario, drawn(scenario, 2), 8000)
    # 12,000 and 48,000 targets: the standard error of the difference is 0.005 at the most.
    assert abs(one[0] - two[0]) < 0.02
    ratios = rms(two[2]) / rms(one[2])
    assert np.all(abs(ratios[np.isfinite(ratios)] - 1) < 0.1)


@nightly
@pytest.mark.parametrize(
    "chain",
    [
        {"n_range_bins": 224, "n_velocity_bins": 128},
        {"range_window": "rectangular", "doppler_window": "rectangular"},
        {"range_window": "blackman-harris", "doppler_window": "chebyshev-60"},
        {"estimator": OrderedStatistic()},
    ],
)
def test_other_windows_padding_and_estimators_agree_as_well(chain):
    agree(scenario_of(radar_of(1), pfa=1e-4, **chain), 1500, within=0.0, rms_within=0.1)


def test_errors_are_what_is_stated_of_them():
    scenario = scenario_of(radar_of(8), snr_db=26.0)
    share, _, errors, stds = score(scenario, drawn(scenario, 3), 300)
    assert share == 1.0
    # 1,800 errors of unit variance: their mean square has a standard error of 3.3 %.
    squares = np.mean((errors / stds) ** 2, axis=1)
    assert np.all((squares > 0.83) & (squares < 1.17))
    # Their means: none, to five standard errors, and 0.1 of one of the targets that are left.
    means = abs(np.mean(errors / stds, axis=1))
    assert np.all(means < 5 / np.sqrt(1800) + 0.1)


@pytest.mark.parametrize("n_elements", [1, 8])
def test_noise_alone_has_as_many_peaks_as_maps_of_it(n_elements):
    scenario = scenario_of(radar_of(n_elements), places=[], pfa=1e-3)
    n_maps = 40
    one = np.array([of_samples(scenario, k)()["frame"].size for k in range(n_maps)])
    frame = drawn(scenario, 4)
    two = np.array([frame()["frame"].size for _ in range(5 * n_maps)])
    # Counts, nearly of Poisson: five standard errors of the difference, and 8 % of law.
    error = np.sqrt(one.mean() / n_maps * (1 + 1 / 5))
    assert abs(one.mean() - two.mean()) < 5 * error + 0.08 * one.mean()
    # A window ties cells together: fewer peaks than the 7.2 cells over threshold.
    assert two.mean() < 6.8


def test_the_table_is_that_of_detect_and_a_seed_gives_it_again():
    scenario = replace(scenario_of(radar_of(8), snr_db=25.0), n_frames=3)
    table = sense(scenario, seed=1)
    detected = dc.detect(
        dc.simulate(scenario.scene, scenario.radar, n_frames=3, seed=1), scenario.radar,
        scenario.chain,
    )  # fmt: skip
    assert list(table) == list(detected)
    assert all(table[name].attrs == detected[name].attrs for name in table)
    assert np.array_equal(np.unique(table.frame), [0, 1, 2])
    assert np.array_equal(np.unique(table.time), np.unique(detected.time))
    assert table.equals(sense(scenario, seed=1))
    assert not table.equals(sense(scenario, seed=2))


def test_turns_of_transmitters_tell_the_fold_where_they_do_in_samples():
    # 40 cells away from zero, where one round tells 32 to each side.
    scenario = scenario_of(radar_of(8), places=[(50.0, 40.0)], snr_db=25.0)
    with pytest.warns(PhysicsWarning, match="is aliased to"):
        table = sense(scenario, seed=1)
    truth = dc.truth(scenario.scene, scenario.radar)
    strongest = table.isel(detection=0)
    assert strongest.ambiguity_number == 1
    assert strongest.velocity == pytest.approx(float(truth.velocity[0, 0]), abs=0.2)
    # One transmitter alone tells no fold: the velocity is a span lower.
    with pytest.warns(PhysicsWarning, match="is aliased to"):
        alone = sense(scenario_of(radar_of(1), places=[(50.0, 40.0)], snr_db=25.0), seed=1)
    span = 2 * radar_of(1).frame.max_velocity_m_per_s
    truth = 40 * radar_of(1).frame.velocity_resolution_m_per_s
    assert np.isnan(alone.ambiguity_number[0])
    assert float(alone.velocity[0]) == pytest.approx(truth - span, abs=0.3)


def test_two_in_one_cell_are_one_detection_of_what_they_add_up_to():
    radar = radar_of(1)
    scenario = scenario_of(radar, places=[(50.0, 5.0)], snr_db=30.0)
    (first,) = scenario.scene.targets
    towards = np.array(first.position_m) / np.linalg.norm(first.position_m)
    half_turn_m = radar.frame.chirp.wavelength_m / 4
    for further_m, gain in ((2 * half_turn_m, 4.0), (half_turn_m, 0.0)):
        at = tuple(np.array(first.position_m) + further_m * towards)
        scene = dc.Scene(targets=(first, replace(first, position_m=at)))
        columns = StatisticalSensor(replace(scenario, scene=scene)).detections(
            np.random.default_rng(1)
        )
        if gain:
            assert columns["snr"].size == 1
            # The ratio has a relative standard error of 6 % here, the noise that it is over 15 %.
            assert columns["snr"][0] == pytest.approx(1000 * gain, rel=0.8)
        else:
            assert columns["snr"].size == 0


def test_a_weak_target_in_the_ring_of_a_strong_one_is_lost_to_a_mean_not_to_a_rank():
    # Six cells apart in range: past the guard, and past the lobe of a Hann window.
    radar, found = radar_of(1), {}
    for name, estimator in (("mean", CellAveraging()), ("rank", OrderedStatistic())):
        scenario = scenario_of(
            radar, places=[(50.0, 0.0), (57.0, 0.0)], snr_db=20.0, estimator=estimator,
            pfa=None, offset=13.0,
        )  # fmt: skip
        weak, strong = scenario.scene.targets
        strong = replace(strong, rcs_m2=1e3 * strong.rcs_m2)
        scenario = replace(scenario, scene=dc.Scene(targets=(weak, strong)))
        matched = score(scenario, drawn(scenario, 5), 200)[0]
        found[name] = 2 * matched - 1
    assert found["mean"] < 0.05
    assert found["rank"] > 0.5


def test_rain_weakens_what_is_drawn_as_it_weakens_samples():
    scenario = scenario_of(radar_of(1), places=[(100.0, 5.0)], snr_db=40.0)
    rain = RainAttenuation(rate_m_per_s=100e-3 / 3600)
    wet = replace(scenario, impairments=(rain, ThermalNoise()))
    cube = [
        dc.simulate(one.scene, one.radar, impairments=one.impairments, seed=1)
        for one in (scenario, wet)
    ]
    power = [float(np.mean(abs(one.values) ** 2)) for one in cube]
    noise = added_noise_w(scenario, scenario.radar)
    loss = (power[1] - noise) / (power[0] - noise)
    snr = [
        StatisticalSensor(one).detections(np.random.default_rng(1))["snr"][0]
        for one in (scenario, wet)
    ]
    assert loss < 0.9
    assert snr[1] / snr[0] == pytest.approx(loss, rel=0.15)


def test_what_is_not_modelled_is_told_or_refused():
    scenario = scenario_of(radar_of(1))
    with pytest.raises(InvalidSetting, match="white noise"):
        StatisticalSensor(replace(scenario, impairments=()))
    recorded = Scenario(radar=scenario.radar, recording=RecordingSource(path="a.bin"))
    with pytest.raises(InvalidSetting, match=r"scenario.recording: a recording.*give a scene"):
        StatisticalSensor(recorded)
    frame = replace(scenario.radar.frame, modulation=dc.modulations.Triangular(), interval_s=30e-6)
    with pytest.raises(InvalidSetting, match=r"frame.modulation: triangular.*simulate samples"):
        StatisticalSensor(replace(scenario, radar=replace(scenario.radar, frame=frame)))
    frame = replace(scenario.radar.frame, interval_s=(15e-6, 17e-6), period_s=2e-3)
    with pytest.raises(InvalidSetting, match=r"frame.interval: intervals in turn"):
        StatisticalSensor(replace(scenario, radar=replace(scenario.radar, frame=frame)))
    with pytest.warns(PhysicsWarning, match="not modelled by"):
        StatisticalSensor(replace(scenario, impairments=(Typical77Ghz(),)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        StatisticalSensor(scenario)
