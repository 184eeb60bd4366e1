"""False alarms, per cell and per frame, and the ROC: what trials measure, theory gives."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation import false_alarms
from dechirp.evaluation.association import Association
from dechirp.evaluation.gates import gate_cells
from dechirp.evaluation.noise_only import count_noise_alarms
from dechirp.evaluation.score.false_alarm_probability import FalseAlarmProbability
from dechirp.evaluation.score.frame_false_alarm_probability import FrameFalseAlarmProbability
from dechirp.evaluation.score.processing_time import ProcessingTime
from dechirp.evaluation.score.roc import Roc
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.processing.cfar.base import NoiseEstimator
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.noise_maps import draw_noise_map
from dechirp.processing.range_doppler_map import equalised_power, range_doppler_power
from dechirp.processing.virtual_array import split_slots
from dechirp.scene.truth import truth
from dechirp.theory.cfar import cell_averaging_false_alarm_probability
from dechirp.theory.cfar_correlated_cells import correlated_factor
from nightly import NIGHTLY
from noise import noise_cube

CONFIDENCE = 1 - 1e-6
SMALL = {"n_training": dc.Cells(range=5, velocity=4), "n_guard": dc.Cells(range=2, velocity=2)}


def sized(radar, n_samples, n_chirps, n_rx=1, **chirp):
    """A radar whose map has that size."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples, **chirp)
    array = dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=n_chirps), array=array)


def chain_of(window="hann", estimator=None, **cfar):
    settings = SMALL | cfar
    if "offset" not in settings:
        settings = {"false_alarm_probability": 1e-3} | settings
    found = dc.Cfar(estimator=estimator or dc.cfar.CellAveraging(), **settings)
    return dc.Chain(range_window=window, doppler_window=window, cfar=found, angle=None)


def case_of(radar, chain, scene, noise_w=1.0, n_frames=1):
    known = truth(scene, radar, n_frames=n_frames, noise_power_w=noise_w)
    return TrialContext(scene, radar, chain, known, noise_w, known.time.values)


def look_of(noise, maps=None):
    nobody = Association(*np.empty((5, 0)))
    return TrialResult(detections={}, association=nobody, maps=maps, noise=noise)


def target_at(row, column, radar, name="car", **settings):
    """A target whose echo lies so many bins along range and velocity, both of any part."""
    chirp = radar.frame.chirp
    velocity = column * radar.frame.velocity_resolution_m_per_s
    beat_m = row * chirp.range_m(chirp.sample_rate_hz) / chirp.n_samples
    start_m = beat_m - chirp.range_doppler_coupling_m(velocity)
    start_m -= velocity * radar.frame.mid_frame_s
    moving = {"position_m": (start_m, 0, 0), "velocity_m_per_s": (velocity, 0, 0)}
    return dc.Target(name=name, **moving, **settings)


def test_false_alarms_of_trials_are_those_that_the_detector_is_made_for(radar):
    radar, chain = sized(radar, 64, 48), chain_of()
    case, rng, score = case_of(radar, chain, dc.Scene()), np.random.default_rng(101), None
    score = FalseAlarmProbability()
    noise = (
        count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain) for _ in range(800)
    )
    sums = np.concatenate([score.trial_sums(look_of(one), case) for one in noise])
    found = score.estimate(sums, confidence=CONFIDENCE)

    assert score.subjects(case) == ()
    assert score.theory(case).tolist() == [1e-3]
    # 2,460 alarms in clusters of 1.5: 2.5 %, five of them either way.
    assert found.low < 1e-3 < found.high < 1.4 * found.low


@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize("n_rx", [1, 2])
def test_an_offset_has_the_false_alarms_of_its_factor(radar, window, n_rx):
    radar = sized(radar, 64, 48, n_rx)
    chain = chain_of(window)
    ring, noise = chain.cfar.training_window, chain.map_noise(radar)
    factor = correlated_factor(1e-4, ring.noise_box(noise, ring.half_range), n_summed=n_rx)
    fixed = replace(chain, cfar=replace(chain.cfar, false_alarm_probability=None, offset=factor))
    found = false_alarms.cell_false_alarm_probability(radar, fixed)
    # At the ends of the range rings are larger, and cells tied to others: a few per cent of 14
    # rows of 64.
    assert found == pytest.approx(1e-4, rel=0.02)
    if window == "rectangular":
        n_cells = ring.n_training_cells(64)
        law = [
            cell_averaging_false_alarm_probability(factor, n_training=int(n), n_summed=n_rx)
            for n in n_cells
        ]
        assert found == pytest.approx(np.mean(law), rel=1e-3)


def test_an_offset_without_a_law_has_none(radar):
    radar = sized(radar, 64, 48)
    ranks = dc.cfar.OrderedStatistic()
    assert np.isnan(
        false_alarms.cell_false_alarm_probability(radar, chain_of("hann", ranks, offset=20.0))
    )
    # So low that noise exceeds it more often than not.
    assert np.isnan(false_alarms.cell_false_alarm_probability(radar, chain_of("hann", offset=0.1)))
    white = chain_of("rectangular", ranks, offset=20.0)
    low = false_alarms.cell_false_alarm_probability(radar, white)
    asked = replace(white.cfar, offset=None, false_alarm_probability=low)
    again = asked.threshold(np.ones((48, 64), np.float32), white.map_noise(radar))
    # The k-th smallest of ones is one; at the ends of the range the factor is another.
    assert again[24, 32] == pytest.approx(20.0, rel=0.02)


@pytest.mark.parametrize(
    ("window", "n_rx"),
    [("hann", 1), ("rectangular", 1), ("blackman-harris", 2)][: 3 if NIGHTLY else 1],
)
def test_frames_of_noise_have_detections_as_often_as_clumps_of_cells_come(radar, window, n_rx):
    radar, score = sized(radar, 64, 64, n_rx), FrameFalseAlarmProbability()
    chain = chain_of(window, false_alarm_probability=5e-5)
    case, rng = case_of(radar, chain, dc.Scene()), np.random.default_rng(102)
    noise = (
        count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain)
        for _ in range(15_000 if NIGHTLY else 3000)
    )
    sums = np.concatenate([score.trial_sums(look_of(one), case) for one in noise])
    found, (law,) = score.estimate(sums, confidence=CONFIDENCE), score.theory(case)
    assert found.low < law < found.high
    # 0.18 of 3,000, to 0.007: five of them.
    assert found.high - found.low < 0.08
    if window == "hann":
        assert law < 0.95 * -np.expm1(-5e-5 * 64 * 64)


def test_frames_have_no_law_where_false_alarms_come_together(radar):
    radar = sized(radar, 64, 64)
    assert np.isnan(
        false_alarms.frame_false_alarm_probability(radar, chain_of(false_alarm_probability=1e-3))
    )
    cleaned = replace(chain_of(false_alarm_probability=1e-6), mitigation=[MeanSubtraction()])
    assert np.isnan(false_alarms.frame_false_alarm_probability(radar, cleaned))


def test_cells_that_clean_up_empties_are_not_tested(radar):
    radar = sized(radar, 64, 48)
    chain = replace(chain_of(), mitigation=[MeanSubtraction()])
    rng = np.random.default_rng(103)
    samples = split_slots(noise_cube(radar, rng).values[0], radar.frame)
    found = count_noise_alarms(
        equalised_power(range_doppler_power(samples, radar, chain), radar, chain), radar, chain
    )
    # Under a Hann window the mean reaches into the bins beside zero velocity.
    assert 48 * 64 - found.n_tested in (64, 3 * 64)
    assert found.n_over <= found.n_tested


@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")  # velocities fold
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("place", [(20.3, 5.4), (25.0, -30.2), (12.5, 0.0)])
def test_the_highest_cell_of_an_echo_lies_in_the_gate_of_its_target(radar, sampling, place):
    radar = sized(radar, 64, 48, sampling=sampling)
    chain = chain_of()
    scene = dc.Scene(targets=[target_at(*place, radar)])
    case = case_of(radar, chain, scene)
    samples = dc.simulate(scene, radar, impairments=()).values[0]
    power = range_doppler_power(split_slots(samples, radar.frame), radar, chain)
    velocity, row = np.unravel_index(power.argmax(), power.shape)

    (gate,) = gate_cells(case)
    assert (velocity, row) in zip(gate.velocity, gate.range, strict=True)
    # Two cells to either side, unpadded.
    assert len(gate.target) == 25


@pytest.mark.parametrize("kind", ["cell-averaging", "ordered-statistic", "smallest-of"])
def test_at_the_chains_own_threshold_the_curve_counts_what_the_detector_does(radar, kind):
    radar = sized(radar, 64, 48)
    chain = chain_of("rectangular", NoiseEstimator.members()[kind]())
    scene = dc.Scene(targets=[target_at(20.3, 5.4, radar), target_at(40, 9, radar, "truck")])
    case, rng = case_of(radar, chain, scene), np.random.default_rng(104)
    score = Roc(false_alarm_probabilities=[1e-1, 1e-3, 1e-5])
    for _ in range(10):
        noise = count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain)
        power = draw_noise_map(radar, chain, 1.0, rng)
        power[5:30, 18:22] *= 12.0
        sums = score.trial_sums(look_of(noise, (power,)), case)

        assert sums.shape == (2, score.n_sums) and np.all(sums[:, 3] == 1)
        assert np.all(sums[:, -1] == noise.n_tested) and np.all(sums[:, 5] == noise.n_over)
        assert np.all(np.diff(sums[:, :3]) <= 0) and np.all(np.diff(sums[:, 4:7]) <= 0)
        over = chain.cfar.exceeds_threshold(power, chain.map_noise(radar))
        (gate,) = gate_cells(case)
        hits = [over[gate.velocity, gate.range][gate.target == of].any() for of in (0, 1)]
        assert sums[:, 1].tolist() == hits


def test_a_measured_curve_holds_what_thresholds_are_made_for_and_what_theory_gives(radar):
    radar, chain, noise_w = sized(radar, 64, 48), chain_of(), 1e-12
    at = target_at(20.3, 5.4, radar, fluctuation="swerling-1")
    plain = truth(dc.Scene(targets=[at]), radar, noise_power_w=noise_w)
    # 15 dB after integration, before the windows' losses.
    at = replace(at, rcs_m2=at.rcs_m2 * 10**1.5 / float(plain.snr.item()))
    scene = dc.Scene(targets=[at])
    case, rng = case_of(radar, chain, scene, noise_w), np.random.default_rng(105)
    score = Roc(false_alarm_probabilities=[1e-1, 1e-2, 1e-3, 1e-4])
    clean = dc.simulate(scene, radar, impairments=(), seed=1)
    # Echoes of unit mean power, each frame's of an exponential one.
    still = dc.simulate(
        dc.Scene(targets=[replace(at, fluctuation="steady")]), radar, impairments=()
    ).values[0]
    assert clean.shape[1:] == still.shape
    rows = []
    for _ in range(1500):
        samples = noise_cube(radar, rng).values[0] * np.float32(np.sqrt(noise_w))
        samples += np.float32(np.sqrt(rng.exponential())) * still
        maps = (range_doppler_power(split_slots(samples, radar.frame), radar, chain),)
        noise = count_noise_alarms(draw_noise_map(radar, chain, noise_w, rng), radar, chain)
        rows.append(score.trial_sums(look_of(noise, maps), case)[0])
    sums = np.array(rows)
    curve, (law,) = score.curve(sums, confidence=CONFIDENCE), score.theory_curve(case)

    assert np.all(
        (curve.false_alarm_low < curve.designed) & (curve.designed < curve.false_alarm_high)
    )
    assert np.all((curve.detection_low < law) & (law < curve.detection_high))
    assert np.all(curve.detection_high - curve.detection_low < 0.14)
    area = score.estimate(sums, confidence=CONFIDENCE)
    assert area.low < score.theory(case)[0] < area.high
    # Of even decades, ends count half.
    assert area.value == pytest.approx(curve.detection_probability @ [1 / 6, 1 / 3, 1 / 3, 1 / 6])


def test_scores_refuse_what_they_cannot_score(radar):
    with pytest.raises(dc.InvalidSetting, match="false_alarm_probabilities"):
        Roc(false_alarm_probabilities=[1e-6, 1e-2])
    with pytest.raises(dc.InvalidSetting, match="false_alarm_probabilities"):
        Roc(false_alarm_probabilities=[1e-6])
    radar, chain = sized(radar, 64, 48), chain_of()
    with pytest.raises(dc.InvalidSetting, match="without targets"):
        Roc().check_context(case_of(radar, chain, dc.Scene()))
    rising = dc.Radar(
        frame=replace(radar.frame, modulation=dc.modulations.Triangular()), array=radar.array
    )
    with pytest.raises(dc.InvalidSetting, match="rise and fall"):
        FrameFalseAlarmProbability().check_context(
            TrialContext(dc.Scene(), rising, chain, None, 1.0, np.zeros(1))  # type: ignore[arg-type]
        )


def test_processing_time_is_a_median_between_times_that_hold_it():
    score, rng = ProcessingTime(), np.random.default_rng(106)
    misses = 0
    for _ in range(1000):
        found = score.estimate(rng.exponential(size=(30, 1)), confidence=0.9)
        assert found.low <= found.value <= found.high
        misses += not found.low < np.log(2) < found.high
    # At most a tenth, as times come in whole ranks: 100, and five standard errors.
    assert 20 < misses < 150
    few = score.estimate(np.array([[1.0], [2.0], [3.0], [np.nan]]), confidence=0.95)
    assert few.value == 2.0 and np.isnan([few.low, few.high]).all()
