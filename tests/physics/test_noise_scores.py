"""False-alarm scores per cell and per frame, and the ROC: trials against theory."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation import false_alarms
from dechirp.evaluation.association import Association
from dechirp.evaluation.false_alarms import count_noise_alarms
from dechirp.evaluation.gates import target_gate_cells
from dechirp.evaluation.score.probabilities import FalseAlarmProbability, FrameFalseAlarmProbability
from dechirp.evaluation.score.processing_time import ProcessingTime
from dechirp.evaluation.score.roc import Roc
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.processing.cfar.base import NoiseEstimator
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.noise_maps import draw_noise_map
from dechirp.processing.range_doppler_map import fill_unusable_cells_with_noise, range_doppler_power
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.scene.truth import truth
from dechirp.theory.cfar import cell_averaging_false_alarm_probability
from dechirp.theory.cfar_correlated_cells import correlated_factor
from nightly import nightly, nightly_except
from noise_cubes import simulate_noise_cube

CONFIDENCE = 1 - 1e-6
SMALL_WINDOW = {
    "n_training": dc.Cells(range=5, velocity=4),
    "n_guard": dc.Cells(range=2, velocity=2),
}


def resize_radar(radar, n_samples, n_chirps, n_rx=1, **chirp):
    """Resize the radar so that its map has that size."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples, **chirp)
    array = dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=n_chirps), array=array)


def build_chain(window="hann", estimator=None, **cfar):
    settings = SMALL_WINDOW | cfar
    if "offset" not in settings:
        settings = {"false_alarm_probability": 1e-3} | settings
    cfar_settings = dc.Cfar(estimator=estimator or dc.cfar.CellAveraging(), **settings)
    return dc.Chain(range_window=window, doppler_window=window, cfar=cfar_settings, angle=None)


def build_context(radar, chain, scene, noise_w=1.0, n_frames=1):
    ground_truth = truth(scene, radar, n_frames=n_frames, noise_power_w=noise_w)
    return TrialContext(scene, radar, chain, ground_truth, noise_w, ground_truth.time.values)


def build_result(noise, maps=None):
    empty_association = Association(*np.empty((5, 0)))
    return TrialResult(detections={}, association=empty_association, maps=maps, noise=noise)


def build_target_at_bin(row, column, radar, name="car", **settings):
    """Build a target whose echo lies at fractional range and velocity bins."""
    chirp = radar.frame.chirp
    velocity = column * radar.frame.velocity_resolution_m_per_s
    beat_m = row * chirp.range_m(chirp.sample_rate_hz) / chirp.n_samples
    start_m = beat_m - chirp.range_doppler_coupling_m(velocity)
    start_m -= velocity * radar.frame.mid_frame_s
    moving = {"position_m": (start_m, 0, 0), "velocity_m_per_s": (velocity, 0, 0)}
    return dc.Target(name=name, **moving, **settings)


def test_false_alarm_score_matches_detector_design(radar):
    radar, chain = resize_radar(radar, 64, 48), build_chain()
    context, rng, score = build_context(radar, chain, dc.Scene()), np.random.default_rng(101), None
    score = FalseAlarmProbability()
    noise = (
        count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain) for _ in range(800)
    )
    sums = np.concatenate([score.trial_sums(build_result(count), context) for count in noise])
    estimate = score.estimate_with_interval(sums, confidence=CONFIDENCE)

    assert score.scored_target_names(context) == ()
    assert score.theoretical_values(context).tolist() == [1e-3]
    # 2,460 alarms in clusters of 1.5: a standard error of 2.5 %, five of them to either side.
    assert estimate.low < 1e-3 < estimate.high < 1.4 * estimate.low


@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize("n_rx", nightly_except(1, [1, 2]))
def test_fixed_offset_has_false_alarm_rate_of_its_factor(radar, window, n_rx):
    radar = resize_radar(radar, 64, 48, n_rx)
    chain = build_chain(window)
    training_window, noise = chain.cfar.training_window, chain.map_noise_statistics(radar)
    factor = correlated_factor(
        1e-4,
        training_window.noise_covariance_in_box(noise, training_window.half_range),
        n_summed=n_rx,
    )
    offset_chain = replace(
        chain, cfar=replace(chain.cfar, false_alarm_probability=None, offset=factor)
    )
    probability = false_alarms.cell_false_alarm_probability(radar, offset_chain)
    # At the ends of the range, training windows are larger and correlated with other cells: a few
    # per cent in 14 rows of 64.
    assert probability == pytest.approx(1e-4, rel=0.02)
    if window == "rectangular":
        n_cells = training_window.n_training_cells_per_row(64)
        law = [
            cell_averaging_false_alarm_probability(factor, n_training=int(n), n_summed=n_rx)
            for n in n_cells
        ]
        assert probability == pytest.approx(np.mean(law), rel=1e-3)


def test_offset_without_theory_gives_nan(radar):
    radar = resize_radar(radar, 64, 48)
    ranks = dc.cfar.OrderedStatistic()
    assert np.isnan(
        false_alarms.cell_false_alarm_probability(radar, build_chain("hann", ranks, offset=20.0))
    )
    # Offset so low that noise exceeds it more often than not.
    assert np.isnan(
        false_alarms.cell_false_alarm_probability(radar, build_chain("hann", offset=0.1))
    )
    rectangular_chain = build_chain("rectangular", ranks, offset=20.0)
    probability = false_alarms.cell_false_alarm_probability(radar, rectangular_chain)
    designed_cfar = replace(
        rectangular_chain.cfar, offset=None, false_alarm_probability=probability
    )
    threshold = designed_cfar.threshold(
        np.ones((48, 64), np.float32), rectangular_chain.map_noise_statistics(radar)
    )
    # The k-th smallest of ones is one; the factor differs at the ends of the range.
    assert threshold[24, 32] == pytest.approx(20.0, rel=0.02)


@nightly
@pytest.mark.parametrize(
    ("window", "n_rx"),
    [("hann", 1), ("rectangular", 1), ("blackman-harris", 2)],
)
def test_frame_false_alarm_rate_matches_clump_theory(radar, window, n_rx):
    radar, score = resize_radar(radar, 64, 64, n_rx), FrameFalseAlarmProbability()
    chain = build_chain(window, false_alarm_probability=5e-5)
    context, rng = build_context(radar, chain, dc.Scene()), np.random.default_rng(102)
    noise = (
        count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain)
        for _ in range(15_000)
    )
    sums = np.concatenate([score.trial_sums(build_result(count), context) for count in noise])
    estimate, (law,) = (
        score.estimate_with_interval(sums, confidence=CONFIDENCE),
        score.theoretical_values(context),
    )
    assert estimate.low < law < estimate.high
    # Probability 0.18 from 15,000 frames: a standard error of 0.0031, five of them to either side.
    assert estimate.high - estimate.low < 0.035
    if window == "hann":
        assert law < 0.95 * -np.expm1(-5e-5 * 64 * 64)


def test_frame_theory_is_nan_for_frequent_false_alarms(radar):
    radar = resize_radar(radar, 64, 64)
    assert np.isnan(
        false_alarms.frame_false_alarm_probability(radar, build_chain(false_alarm_probability=1e-3))
    )
    mitigation_chain = replace(
        build_chain(false_alarm_probability=1e-6), mitigation=[MeanSubtraction()]
    )
    assert np.isnan(false_alarms.frame_false_alarm_probability(radar, mitigation_chain))


@pytest.mark.parametrize("n_range_bins", [None, 128])
def test_frame_theory_of_real_samples_includes_the_ends_of_the_range_axis(radar, n_range_bins):
    chain = replace(build_chain(false_alarm_probability=1e-6), n_range_bins=n_range_bins)
    exponents = {}
    for sampling in ("complex", "real"):
        resized = resize_radar(radar, 64, 48, sampling=sampling)
        law = false_alarms.frame_false_alarm_probability(resized, chain)
        exponents[sampling] = -np.log1p(-law)
    power = dc.power_map(simulate_noise_cube(resized, np.random.default_rng(1)), resized, chain)
    is_searched = np.isfinite(dc.threshold_map(power, resized, chain).values)
    # Opposite velocities have the same power at half the sample rate.
    n_cells = is_searched[:, :-1].sum() + is_searched[:, -1].sum() / 2
    per_cell = exponents["complex"] / (48 * (n_range_bins or 64))
    assert exponents["real"] == pytest.approx(n_cells * per_cell, rel=1e-9)


def test_peaks_at_half_the_sample_rate_of_real_samples_are_counted(radar):
    radar = resize_radar(radar, 64, 48, sampling="real")
    power = np.random.default_rng(2).exponential(size=(48, 33)).astype(np.float32)
    power[[14, 34], 32] = 1e3  # velocities of 10 cells, receding and approaching

    counts = count_noise_alarms(power, radar, build_chain(false_alarm_probability=1e-9))

    assert (counts.n_over, counts.n_peaks) == (0, 1)


def test_cells_emptied_by_mitigation_are_not_tested(radar):
    radar = resize_radar(radar, 64, 48)
    chain = replace(build_chain(), mitigation=[MeanSubtraction()])
    rng = np.random.default_rng(103)
    samples = split_chirps_into_slots(simulate_noise_cube(radar, rng).values[0], radar.frame)
    counts = count_noise_alarms(
        fill_unusable_cells_with_noise(range_doppler_power(samples, radar, chain), radar, chain),
        radar,
        chain,
    )
    # A Hann window spreads the mean into the bins adjacent to zero velocity.
    assert 48 * 64 - counts.n_tested in (64, 3 * 64)
    assert counts.n_over <= counts.n_tested


@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")  # aliased velocities
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("bins", [(20.3, 5.4), (25.0, -30.2), (12.5, 0.0)])
def test_peak_cell_of_echo_lies_in_gate_of_its_target(radar, sampling, bins):
    radar = resize_radar(radar, 64, 48, sampling=sampling)
    chain = build_chain()
    scene = dc.Scene(targets=[build_target_at_bin(*bins, radar)])
    context = build_context(radar, chain, scene)
    samples = dc.simulate(scene, radar, impairments=()).values[0]
    power = range_doppler_power(split_chirps_into_slots(samples, radar.frame), radar, chain)
    velocity, row = np.unravel_index(power.argmax(), power.shape)

    (gate,) = target_gate_cells(context)
    assert (velocity, row) in zip(gate.velocity, gate.range, strict=True)
    # Two cells to either side, without zero padding.
    assert len(gate.target) == 25


@pytest.mark.parametrize("kind", ["cell-averaging", "ordered-statistic", "smallest-of"])
def test_roc_at_chain_threshold_counts_detector_alarms(radar, kind):
    radar = resize_radar(radar, 64, 48)
    chain = build_chain("rectangular", NoiseEstimator.members()[kind]())
    scene = dc.Scene(
        targets=[build_target_at_bin(20.3, 5.4, radar), build_target_at_bin(40, 9, radar, "truck")]
    )
    context, rng = build_context(radar, chain, scene), np.random.default_rng(104)
    score = Roc(false_alarm_probabilities=[1e-1, 1e-3, 1e-5])
    for _ in range(10):
        noise = count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain)
        power = draw_noise_map(radar, chain, 1.0, rng)
        power[5:30, 18:22] *= 12.0
        sums = score.trial_sums(build_result(noise, (power,)), context)

        assert sums.shape == (2, score.n_sums) and np.all(sums[:, 3] == 1)
        assert np.all(sums[:, -1] == noise.n_tested) and np.all(sums[:, 5] == noise.n_over)
        assert np.all(np.diff(sums[:, :3]) <= 0) and np.all(np.diff(sums[:, 4:7]) <= 0)
        is_alarm = chain.cfar.exceeds_threshold(power, chain.map_noise_statistics(radar))
        (gate,) = target_gate_cells(context)
        hits = [is_alarm[gate.velocity, gate.range][gate.target == index].any() for index in (0, 1)]
        assert sums[:, 1].tolist() == hits


@nightly
def test_measured_roc_encloses_design_and_theory(radar):
    radar, chain, noise_w = resize_radar(radar, 64, 48), build_chain(), 1e-12
    target = build_target_at_bin(20.3, 5.4, radar, fluctuation="swerling-1")
    unscaled_truth = truth(dc.Scene(targets=[target]), radar, noise_power_w=noise_w)
    # 15 dB after integration, before the windows' losses.
    target = replace(target, rcs_m2=target.rcs_m2 * 10**1.5 / float(unscaled_truth.snr.item()))
    scene = dc.Scene(targets=[target])
    context, rng = build_context(radar, chain, scene, noise_w), np.random.default_rng(105)
    score = Roc(false_alarm_probabilities=[1e-1, 1e-2, 1e-3, 1e-4])
    clean = dc.simulate(scene, radar, impairments=(), seed=1)
    # Swerling 1: exponentially distributed echo power of each frame.
    steady_echo = dc.simulate(
        dc.Scene(targets=[replace(target, fluctuation="steady")]), radar, impairments=()
    ).values[0]
    assert clean.shape[1:] == steady_echo.shape
    rows = []
    for _ in range(500):
        samples = simulate_noise_cube(radar, rng).values[0] * np.float32(np.sqrt(noise_w))
        samples += np.float32(np.sqrt(rng.exponential())) * steady_echo
        maps = (range_doppler_power(split_chirps_into_slots(samples, radar.frame), radar, chain),)
        noise = count_noise_alarms(draw_noise_map(radar, chain, noise_w, rng), radar, chain)
        rows.append(score.trial_sums(build_result(noise, maps), context)[0])
    sums = np.array(rows)
    curve, (law,) = (
        score.estimate_roc_curve(sums, confidence=CONFIDENCE),
        score.theoretical_roc_probabilities(context),
    )

    assert np.all(
        (curve.false_alarm_low < curve.designed) & (curve.designed < curve.false_alarm_high)
    )
    assert np.all((curve.detection_low < law) & (law < curve.detection_high))
    assert np.all(curve.detection_high - curve.detection_low < 0.24)
    area = score.estimate_with_interval(sums, confidence=CONFIDENCE)
    assert area.low < score.theoretical_values(context)[0] < area.high
    # Trapezoidal rule over equal decades: the ends count half.
    assert area.value == pytest.approx(curve.detection_probability @ [1 / 6, 1 / 3, 1 / 3, 1 / 6])


def test_rejects_contexts_that_scores_cannot_evaluate(radar):
    with pytest.raises(dc.InvalidSetting, match="false_alarm_probabilities"):
        Roc(false_alarm_probabilities=[1e-6, 1e-2])
    with pytest.raises(dc.InvalidSetting, match="false_alarm_probabilities"):
        Roc(false_alarm_probabilities=[1e-6])
    radar, chain = resize_radar(radar, 64, 48), build_chain()
    with pytest.raises(dc.InvalidSetting, match="without targets"):
        Roc().check_score_defined(build_context(radar, chain, dc.Scene()))
    triangular_radar = dc.Radar(
        frame=replace(radar.frame, modulation=dc.modulations.Triangular()), array=radar.array
    )
    with pytest.raises(dc.InvalidSetting, match="rising and falling"):
        FrameFalseAlarmProbability().check_score_defined(
            TrialContext(dc.Scene(), triangular_radar, chain, None, 1.0, np.zeros(1))  # type: ignore[arg-type]
        )


def test_processing_time_is_median_with_confidence_interval():
    score, rng = ProcessingTime(), np.random.default_rng(106)
    misses = 0
    for _ in range(1000):
        estimate = score.estimate_with_interval(rng.exponential(size=(30, 1)), confidence=0.9)
        assert estimate.low <= estimate.value <= estimate.high
        misses += not estimate.low < np.log(2) < estimate.high
    # At most a tenth, because limits are order statistics: 100, and five standard errors.
    assert 20 < misses < 150
    short_estimate = score.estimate_with_interval(
        np.array([[1.0], [2.0], [3.0], [np.nan]]), confidence=0.95
    )
    assert short_estimate.value == 2.0 and np.isnan([short_estimate.low, short_estimate.high]).all()
