"""Statistical sensor: detections drawn from theory, against detections of simulated samples."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning
from dechirp.evaluation.association import Associator
from dechirp.experiments.link_budget import added_noise_power_w
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.experiments.statistical.sensor import StatisticalSensor, draw_statistical_detections
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
from dechirp.simulation.impairments.automotive_chip import AutomotiveChip
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.impairments.rain_attenuation import RainAttenuation
from nightly import nightly, nightly_except

TARGET_CELLS = [
    (18.0, -20.0),
    (18.5, 12.25),
    (50.25, -20.5),
    (50.0, 12.4),
    (83.3, -20.3),
    (83.75, 12.0),
]
ERRORS = ("range_error_m", "velocity_error_m_per_s", "azimuth_error_rad")
STDS = ("range_std", "velocity_std", "azimuth_std")


def build_radar(n_elements):
    """Build a radar of 64 chirps and 112 samples; 8 elements are two TDM transmitters x 4 rx."""
    half_m = 1.95e-3
    chirp = Chirp(
        start_frequency_hz=76.5e9, slope_hz_per_s=20e12, adc_start_s=2e-6, ramp_duration_s=12e-6,
        sample_rate_hz=12.8e6, n_samples=112, sampling="complex",
    )  # fmt: skip
    tdm = Tdm(order=(0, 1)) if n_elements > 1 else None
    n_rx = max(n_elements // 2, 1)
    array = Array(
        tx_m=tuple((0.0, k * n_rx * half_m, 0.0) for k in range(1 + (tdm is not None))),
        rx_m=tuple((0.0, k * half_m, 0.0) for k in range(n_rx)),
    )
    return Radar(
        frame=Frame(chirp=chirp, n_chirps=64, interval_s=15e-6, multiplexing=tdm),
        array=array,
        hardware=Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
    )


def build_scenario(
    radar, target_cells=TARGET_CELLS, snr_db=16.0, fluctuation="steady", pfa=1e-5, **chain
):
    """Build targets of equal SNR at given cells, each at another azimuth."""
    frame, targets = radar.frame, []
    for row, (range_cell, velocity_cell) in enumerate(target_cells):
        azimuth = np.radians(8.0 * row - 20)
        direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        velocity = velocity_cell * frame.velocity_resolution_m_per_s
        range_m = range_cell * frame.chirp.range_resolution_m
        range_m -= frame.chirp.range_doppler_coupling_m(velocity)
        target = dc.Target(
            position_m=tuple(range_m * direction), velocity_m_per_s=tuple(velocity * direction)
        )
        unit_snr = float(dc.truth(dc.Scene(targets=(target,)), radar).snr[0, 0])
        rcs_m2 = 10 ** (snr_db / 10) / unit_snr
        targets.append(replace(target, rcs_m2=rcs_m2, fluctuation=fluctuation))
    cfar = Cfar(
        estimator=chain.pop("estimator", CellAveraging()), n_training=Cells(range=8, velocity=6),
        n_guard=Cells(range=3, velocity=3), false_alarm_probability=pfa,
        offset=chain.pop("offset", None),
    )  # fmt: skip
    return Scenario(
        radar=radar, scene=dc.Scene(targets=tuple(targets)), chain=Chain(cfar=cfar, **chain)
    )


def score_detections(scenario, frame, n_trials):
    """Score detections: share of targets, false alarms per frame, errors (3, n), stds (3, n)."""
    noise_w = added_noise_power_w(scenario, scenario.radar)
    truth = dc.truth(scenario.scene, scenario.radar, noise_power_w=noise_w)
    associator, n_found, n_false, errors, stds = Associator(truth, scenario.radar), 0, 0, [], []
    for _ in range(n_trials):
        columns = frame()
        match = associator(columns)
        is_matched = match.target >= 0
        n_found += len(np.unique(match.target[is_matched]))
        n_false += np.sum(~is_matched)
        errors.append(np.array([getattr(match, name) for name in ERRORS])[:, is_matched])
        stds.append(np.array([columns[name] for name in STDS])[:, is_matched])
    errors, stds = np.concatenate(errors, axis=1), np.concatenate(stds, axis=1)
    # Outliers: false alarms within two cells of a target, and refinements that end on a sidelobe,
    # one in 100 under a rectangular window. Neither follows these error distributions.
    is_regular = ~np.any(abs(errors) > 6 * np.median(stds, axis=1, keepdims=True), axis=0)
    n = n_trials * len(scenario.scene.targets)
    return n_found / max(n, 1), n_false / n_trials, errors[:, is_regular], stds[:, is_regular]


def make_sample_source(scenario, seed):
    rng, chain = np.random.default_rng(seed), scenario.chain.fit_to_radar(scenario.radar)

    def draw_frame():
        cube = dc.simulate(scenario.scene, scenario.radar, seed=rng)
        return detect_columns([cube], scenario.radar, chain)

    return draw_frame


def make_statistical_source(scenario, seed):
    sensor, rng = StatisticalSensor(scenario), np.random.default_rng(seed)
    return lambda: sensor.draw_detections(rng)


def compute_rms(errors):
    return np.sqrt(np.mean(errors**2, axis=1))


def check_agreement(scenario, n_trials, *, share_tolerance, rms_tolerance):
    """Check that both scores agree within the tolerance plus five standard errors."""
    sample_score = score_detections(scenario, make_sample_source(scenario, 1), n_trials)
    statistical_score = score_detections(scenario, make_statistical_source(scenario, 2), n_trials)
    share = (sample_score[0] + statistical_score[0]) / 2
    n = n_trials * len(scenario.scene.targets)
    assert abs(sample_score[0] - statistical_score[0]) <= share_tolerance + 5 * np.sqrt(
        2 * share * (1 - share) / n
    )
    for sample_rms, statistical_rms in zip(
        compute_rms(sample_score[2]), compute_rms(statistical_score[2]), strict=True
    ):
        if np.isfinite(sample_rms):
            assert abs(statistical_rms / sample_rms - 1) <= rms_tolerance + 5 / np.sqrt(
                sample_score[2].shape[1]
            )


# 600 targets: five standard errors of the difference are 0.14 at the most.
@pytest.mark.parametrize(
    ("n_elements", "fluctuation"), nightly_except(1, [(1, "steady"), (8, "swerling-1")])
)
def test_statistical_detections_match_sample_detections(n_elements, fluctuation):
    snr_db = 16.0 if n_elements == 1 else 17.5
    scenario = build_scenario(build_radar(n_elements), snr_db=snr_db, fluctuation=fluctuation)
    check_agreement(scenario, 100, share_tolerance=0.0, rms_tolerance=0.0)


@nightly
@pytest.mark.parametrize("n_elements", [1, 8])
@pytest.mark.parametrize("fluctuation", ["steady", "swerling-1"])
@pytest.mark.parametrize("more_db", [-2, 0, 1.5, 5])
def test_probabilities_agree_within_0_02_and_errors_within_a_tenth(
    n_elements, fluctuation, more_db
):
    snr_db = (16.0 if n_elements == 1 else 17.5) + more_db
    scenario = build_scenario(build_radar(n_elements), snr_db=snr_db, fluctuation=fluctuation)
    sample_score = score_detections(scenario, make_sample_source(scenario, 1), 2000)
    statistical_score = score_detections(scenario, make_statistical_source(scenario, 2), 8000)
    # 12,000 and 48,000 targets: the standard error of the difference is 0.005 at the most.
    assert abs(sample_score[0] - statistical_score[0]) < 0.02
    ratios = compute_rms(statistical_score[2]) / compute_rms(sample_score[2])
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
def test_windows_padding_and_estimators_agree_with_samples(chain):
    check_agreement(
        build_scenario(build_radar(1), pfa=1e-4, **chain),
        1500,
        share_tolerance=0.0,
        rms_tolerance=0.1,
    )


@nightly
def test_errors_match_stated_standard_errors():
    scenario = build_scenario(build_radar(8), snr_db=26.0)
    share, _, errors, stds = score_detections(scenario, make_statistical_source(scenario, 3), 150)
    assert share == 1.0
    # 900 errors of unit variance: their mean square has a standard error of 4.7 %.
    squares = np.mean((errors / stds) ** 2, axis=1)
    assert np.all((squares > 0.76) & (squares < 1.24))
    # Mean errors: zero within five standard errors, plus a bias of 0.1 from other targets.
    means = abs(np.mean(errors / stds, axis=1))
    assert np.all(means < 5 / np.sqrt(900) + 0.1)


@nightly
@pytest.mark.parametrize("n_elements", [1, 8])
def test_number_of_noise_peaks_matches_sample_maps(n_elements):
    scenario = build_scenario(build_radar(n_elements), target_cells=[], pfa=1e-3)
    n_maps, n_draws = 16, 200
    sample_counts = np.array(
        [make_sample_source(scenario, k)()["frame"].size for k in range(n_maps)]
    )
    draw_frame = make_statistical_source(scenario, 4)
    statistical_counts = np.array([draw_frame()["frame"].size for _ in range(n_draws)])
    # Counts are nearly Poisson: five standard errors of the difference, plus 8 % model error.
    error = np.sqrt(sample_counts.mean() * (1 / n_maps + 1 / n_draws))
    assert (
        abs(sample_counts.mean() - statistical_counts.mean())
        < 5 * error + 0.08 * sample_counts.mean()
    )
    # Windows correlate cells: fewer peaks than the 7.2 cells over threshold.
    assert statistical_counts.mean() < 6.8


@nightly
def test_table_has_layout_of_detect_and_depends_on_seed():
    scenario = replace(build_scenario(build_radar(8), snr_db=25.0), n_frames=3)
    table = draw_statistical_detections(scenario, seed=1)
    detected = dc.detect(
        dc.simulate(scenario.scene, scenario.radar, n_frames=3, seed=1), scenario.radar,
        scenario.chain,
    )  # fmt: skip
    assert list(table) == list(detected)
    assert all(table[name].attrs == detected[name].attrs for name in table)
    assert np.array_equal(np.unique(table.frame), [0, 1, 2])
    assert np.array_equal(np.unique(table.time), np.unique(detected.time))
    assert table.equals(draw_statistical_detections(scenario, seed=1))
    assert not table.equals(draw_statistical_detections(scenario, seed=2))


def test_tdm_resolves_velocity_ambiguity_as_in_samples():
    # Velocity of 40 cells, beyond the unambiguous 32 cells to each side.
    scenario = build_scenario(build_radar(8), target_cells=[(50.0, 40.0)], snr_db=25.0)
    with pytest.warns(PhysicsWarning, match="is aliased to"):
        table = draw_statistical_detections(scenario, seed=1)
    truth = dc.truth(scenario.scene, scenario.radar)
    strongest = table.isel(detection=0)
    assert strongest.ambiguity_number == 1
    assert strongest.velocity == pytest.approx(float(truth.velocity[0, 0]), abs=0.2)
    # A single transmitter cannot resolve the ambiguity: the velocity is one span lower.
    with pytest.warns(PhysicsWarning, match="is aliased to"):
        single_tx_table = draw_statistical_detections(
            build_scenario(build_radar(1), target_cells=[(50.0, 40.0)], snr_db=25.0), seed=1
        )
    span = 2 * build_radar(1).frame.max_velocity_m_per_s
    truth = 40 * build_radar(1).frame.velocity_resolution_m_per_s
    assert np.isnan(single_tx_table.ambiguity_number[0])
    assert float(single_tx_table.velocity[0]) == pytest.approx(truth - span, abs=0.3)


def test_two_targets_in_one_cell_give_detection_of_coherent_sum():
    radar = build_radar(1)
    scenario = build_scenario(radar, target_cells=[(50.0, 5.0)], snr_db=30.0)
    (first_target,) = scenario.scene.targets
    direction = np.array(first_target.position_m) / np.linalg.norm(first_target.position_m)
    half_turn_m = radar.frame.chirp.wavelength_m / 4
    for further_m, gain in ((2 * half_turn_m, 4.0), (half_turn_m, 0.0)):
        second_position_m = tuple(np.array(first_target.position_m) + further_m * direction)
        scene = dc.Scene(
            targets=(first_target, replace(first_target, position_m=second_position_m))
        )
        columns = StatisticalSensor(replace(scenario, scene=scene)).draw_detections(
            np.random.default_rng(1)
        )
        if gain:
            assert columns["snr"].size == 1
            # Relative standard errors: 6 % of the SNR itself, 15 % of the noise estimate.
            assert columns["snr"][0] == pytest.approx(1000 * gain, rel=0.8)
        else:
            assert columns["snr"].size == 0


@nightly
def test_scatterers_of_a_body_form_the_strongest_peak_of_its_samples():
    # Six echoes within three cells, as of a car, add up to a peak that may be beside all of them.
    # At 40 dB, noise moves it by 0.02 cells at most (CRLB of one tone, 5 standard deviations), and
    # the cubic terms that two Newton steps neglect by some hundredths. In a quarter of the groups,
    # two peaks lie so near each other that refinement of samples ends elsewhere.
    radar = build_radar(1)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(40):
        cells = np.array([50.0, 12.0]) + rng.uniform(-1.5, 1.5, (6, 2))
        scenario = build_scenario(radar, [tuple(cell) for cell in cells], snr_db=40.0)
        samples = dc.detect(dc.simulate(scenario.scene, radar, seed=1), radar, scenario.chain)
        drawn = draw_statistical_detections(scenario)
        strongest = samples.isel(detection=int(np.argmax(samples.snr.values)))
        range_cells = (drawn.range - strongest.range) / radar.frame.chirp.range_resolution_m
        velocity_cells = (drawn.velocity - strongest.velocity) / (
            radar.frame.velocity_resolution_m_per_s
        )
        errors.append(np.hypot(range_cells, velocity_cells).values.min())

    assert np.mean(np.array(errors) < 0.1) >= 0.75


@nightly
def test_strong_target_masks_weak_one_for_cell_averaging_only():
    # Separation beyond the guard cells and beyond the main lobe of a Hann window.
    radar, weak_shares = build_radar(1), {}
    for name, estimator in (("mean", CellAveraging()), ("rank", OrderedStatistic())):
        scenario = build_scenario(
            radar, target_cells=[(50.0, 0.0), (57.0, 0.0)], snr_db=20.0, estimator=estimator,
            pfa=None, offset=13.0,
        )  # fmt: skip
        weak_target, strong_target = scenario.scene.targets
        strong_target = replace(strong_target, rcs_m2=1e3 * strong_target.rcs_m2)
        scenario = replace(scenario, scene=dc.Scene(targets=(weak_target, strong_target)))
        share = score_detections(scenario, make_statistical_source(scenario, 5), 200)[0]
        weak_shares[name] = 2 * share - 1
    assert weak_shares["mean"] < 0.05
    assert weak_shares["rank"] > 0.5


def test_rain_attenuates_statistical_detections_like_samples():
    scenario = build_scenario(build_radar(1), target_cells=[(100.0, 5.0)], snr_db=40.0)
    rain = RainAttenuation(rate_m_per_s=100e-3 / 3600)
    rain_scenario = replace(scenario, impairments=(rain, ThermalNoise()))
    cubes = [
        dc.simulate(case.scene, case.radar, impairments=case.impairments, seed=1)
        for case in (scenario, rain_scenario)
    ]
    power = [float(np.mean(abs(case.values) ** 2)) for case in cubes]
    noise = added_noise_power_w(scenario, scenario.radar)
    loss = (power[1] - noise) / (power[0] - noise)
    snr = [
        StatisticalSensor(case).draw_detections(np.random.default_rng(1))["snr"][0]
        for case in (scenario, rain_scenario)
    ]
    assert loss < 0.9
    assert snr[1] / snr[0] == pytest.approx(loss, rel=0.15)


def test_warns_of_or_rejects_unmodelled_settings():
    scenario = build_scenario(build_radar(1))
    with pytest.raises(InvalidSetting, match="white noise"):
        StatisticalSensor(replace(scenario, impairments=()))
    recording_scenario = Scenario(radar=scenario.radar, recording=RecordingSource(path="a.bin"))
    with pytest.raises(InvalidSetting, match=r"scenario: a recording, or traffic.*give a scene"):
        StatisticalSensor(recording_scenario)
    frame = replace(scenario.radar.frame, modulation=dc.modulations.Triangular(), interval_s=30e-6)
    with pytest.raises(InvalidSetting, match=r"frame.modulation: triangular.*simulate samples"):
        StatisticalSensor(replace(scenario, radar=replace(scenario.radar, frame=frame)))
    frame = replace(scenario.radar.frame, interval_s=(15e-6, 17e-6), period_s=2e-3)
    with pytest.raises(InvalidSetting, match=r"frame.interval: intervals in turn"):
        StatisticalSensor(replace(scenario, radar=replace(scenario.radar, frame=frame)))
    with pytest.warns(PhysicsWarning, match="not modelled by"):
        StatisticalSensor(replace(scenario, impairments=(AutomotiveChip(),)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        StatisticalSensor(scenario)


@nightly
def test_scatterers_that_cancel_in_a_peak_leave_no_snr_below_its_threshold():
    # Six scatterers within 1.4 cells: often they cancel where the strongest one is.
    radar = build_radar(8)
    scenario = build_scenario(radar, target_cells=[(50.0, 5.0)], snr_db=16.0, pfa=1e-6)
    (target,) = scenario.scene.targets
    position_m, velocity = np.array(target.position_m), np.array(target.velocity_m_per_s)
    direction = position_m / np.linalg.norm(position_m)
    cells = radar.frame.chirp.range_resolution_m, radar.frame.velocity_resolution_m_per_s
    rng, snr = np.random.default_rng(3), []
    for _ in range(500):
        range_m, rate = rng.uniform(-0.7, 0.7, (6, 2, 1)).swapaxes(0, 1) * np.reshape(
            cells, (2, 1, 1)
        )
        scene = dc.Scene(
            targets=tuple(
                replace(target, position_m=tuple(place), velocity_m_per_s=tuple(speed))
                for place, speed in zip(
                    position_m + range_m * direction, velocity + rate * direction, strict=True
                )
            )
        )
        sensor = StatisticalSensor(replace(scenario, scene=scene))
        snr += sensor.draw_detections(rng)["snr"].tolist()
    assert len(snr) > 250
    # The least SNR of the tones of 500 frames from samples is 10 dB; half of it for noise.
    assert min(snr) > 5
