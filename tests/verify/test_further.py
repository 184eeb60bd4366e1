"""What `--full` certifies beyond the report: nothing is left out, and what is worse fails."""

from dataclasses import replace

import numpy as np
import pytest

from dechirp.certificate import directions, every_detector, extended
from dechirp.certificate.directions import run_one_source_trials, run_two_source_trials
from dechirp.certificate.impairments.measurement import Measurement, Quantity
from dechirp.certificate.reference_trials import (
    REFERENCE_TARGET,
    motion_at_mid_frame,
    reference_radar,
    unit_power_echo,
)
from dechirp.certificate.sensitivity import snr_gain_in_map
from dechirp.core.units import to_decibels
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.cfar.base import NoiseEstimator
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.processing.spectrum import Transform
from dechirp.simulation.impairments.base import Impairment
from dechirp.theory.bounds import angle_std_rad
from dechirp.theory.windows import window_weights

BY_KIND = {one.kind: one for one in extended.IMPAIRMENT_MEASUREMENTS}


def test_every_member_of_each_family_is_certified():
    assert set(BY_KIND) == set(Impairment.members())
    assert set(every_detector.all_detectors()) == set(NoiseEstimator.members())
    named = {name.rpartition(", ")[2] for name in directions.trial_jobs(1)}
    assert named == set(DirectionEstimator.members())


# Of noise four trials in place of many: within four times what all of them must show.
@pytest.mark.parametrize("kind", sorted(BY_KIND))
def test_an_impairment_is_as_its_formula_says(kind):
    one = BY_KIND[kind]
    if one.n_trials > 1:
        found = [one.measure(np.random.default_rng(seed)) for seed in range(4)]
        within = 4 * np.array([quantity.tolerance for quantity in one.quantities])
    else:
        found = [one.measure(np.random.default_rng(0))]
        within = np.array([quantity.tolerance for quantity in one.quantities])
    measured, formula = np.mean(found, axis=0).T
    assert np.all(abs(measured - formula) <= within)


@pytest.mark.parametrize(
    ("off", "passes"), [(0.0, True), (0.04, True), (0.11, False), (-0.11, False), (np.nan, False)]
)
def test_a_measurement_that_is_off_by_more_than_is_allowed_fails(off, passes):
    one = Measurement(
        kind="made-up",
        claim="A number is three.",
        quantities=(Quantity(name="number", unit="dB", tolerance=0.1),),
        measure=lambda rng: ((3.0 + off + 0.03 * rng.standard_normal(), 3.0),),
        n_trials=64,
    )
    job = one.trial_job()
    trials = job.work(np.random.default_rng(1), 64, **job.arguments)
    claim = one.evaluate_claim({one.job_name: trials})
    assert claim.passed == passes
    assert (claim.id, claim.checks[0].limit) == ("impairment_made_up", 3.0)


def test_the_bound_of_a_direction_is_that_of_a_line():
    rng = np.random.default_rng(2)
    array, azimuth = directions.linear_array(), rng.uniform(-1, 1, (5, 1))
    amplitudes = np.exp(1j * rng.uniform(0, 6, (5, 1)))
    bound = directions.azimuth_bounds_rad(array, azimuth, amplitudes, 0.01)
    expected = angle_std_rad(
        snr=100.0, positions_m=array.positions[:, 1], wavelength_m=1.0, angle_rad=azimuth
    )
    np.testing.assert_allclose(bound, expected, rtol=1e-9)


@pytest.mark.parametrize("kind", sorted(DirectionEstimator.members()))
def test_looks_at_directions_give_what_the_claims_judge(kind):
    member = DirectionEstimator.members()[kind]
    found = run_one_source_trials(np.random.default_rng(3), 300, estimator=member())
    # A root mean square of 300 is known to 4 %: five of those.
    assert np.sqrt(np.mean((found[:, 0] / found[:, 1]) ** 2)) == pytest.approx(1, abs=0.2)
    pairs = directions._two_source_estimator(member)
    if pairs is not None:
        far = 2 * directions.BEAMWIDTH
        both = run_two_source_trials(np.random.default_rng(4), 40, estimator=pairs, separation=far)
        assert both.mean(axis=0) == pytest.approx([1.0, 1.0])


def direction_results(rng, *, errors=1.0, own=1.0, lost=0.0):
    n = 10_000
    made = {}
    for name in directions.trial_jobs(1):
        if name.startswith("one"):
            made[name] = np.stack([errors * rng.standard_normal(n), np.full(n, own)], axis=1)
        else:
            made[name] = np.stack([rng.random(n) >= lost, np.ones(n)], axis=1)
    return made


@pytest.mark.parametrize(
    ("worse", "passes"),
    [
        ({}, True),
        ({"errors": 1.3, "own": 1.3}, True),  # it loses, and says so
        ({"errors": 1.15}, False),  # it says less than it errs
        ({"errors": 0.9, "own": 0.9}, False),  # better than the bound
        ({"lost": 0.2}, False),
        ({"errors": np.nan}, False),
    ],
    ids=str,
)
def test_a_direction_estimator_that_is_worse_than_it_says_fails(worse, passes):
    results = direction_results(np.random.default_rng(5), **worse)
    assert {claim.passed for claim in directions.build_part(results).claims} >= {passes}
    if passes:
        assert all(claim.passed for claim in directions.build_part(results).claims)


def noise_results(rng, times):
    """Counts of alarms as frames of noise give them, of detectors that alarm so often."""
    made = {}
    for name, job in every_detector.trial_jobs(None, every_detector.MIN_CELLS).items():
        group = every_detector.MAP_GROUPS[name]
        shape = (job.n_trials, len(group), len(times))
        cells = np.array([maps.n_cells for maps in group])[:, None]
        ends = 28 * reference_radar().frame.n_chirps
        mean = every_detector.FALSE_ALARM_PROBABILITY * np.array(times)
        at_ends = rng.poisson(mean * ends, shape)
        made[name] = np.stack([rng.poisson(mean * (cells - ends), shape) + at_ends, at_ends], -1)
    return made


def test_a_detector_that_alarms_too_often_or_too_seldom_fails():
    times = [1.0, 1.1, 1.3, 0.75, 0.9, 1.0]
    results = noise_results(np.random.default_rng(6), times)
    claims = every_detector.build_part(results).claims
    assert [claim.passed for claim in claims] == [0.8 < one < 1.25 for one in times]
    # Ten thousand alarms: a half width of 4.4 %, as the choice of the design says.
    check = claims[0].checks[0]
    assert check.trials >= 1e9
    assert (check.high - check.low) / 2 == pytest.approx(0.044, abs=0.003)


def test_maps_are_judged_as_the_chain_judges_them():
    maps = every_detector.NoiseMaps(window="rectangular", n_range_bins=every_detector.N_SAMPLES)
    cfar = replace(every_detector.all_detectors()["greatest-of"], false_alarm_probability=1e-2)
    rows = every_detector.calibrate_factor(np.random.default_rng(0), 1, maps=maps, cfar=cfar)[0]
    counts = every_detector.count_alarms(
        np.random.default_rng(7), 2, group=(maps,), judges=[[(cfar, rows)]]
    )

    rng, seen = np.random.default_rng(7), every_detector.small_radar()
    chain = replace(maps.chain, cfar=cfar)
    for whole, ends in counts[:, 0, 0]:
        samples = every_detector.complex_white_noise(rng, (128, 1, 256))
        power = range_doppler_power(samples, seen, chain)
        over = power > cfar.threshold(power, chain.map_noise(seen))
        assert whole == over.sum() > 200
        assert ends == over[:, :14].sum() + over[:, -14:].sum()


# Theory takes a tone; the echo walks through six hundredths of a cell: 0.0001 dB. A Doppler
# frequency that forgets that delay lowers what is sent, by 9e-5, is 0.002 dB off.
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_the_ratio_in_the_cell_of_the_reference_target_is_that_of_its_echo(window):
    samples = unit_power_echo(*REFERENCE_TARGET).values[0, :, 0].astype(np.complex128)
    weights = [window_weights(window, n) for n in samples.shape]
    power = abs(np.fft.fft2(samples * np.outer(*weights))) ** 2
    gain = power.max() / np.mean(abs(samples) ** 2) / np.prod([np.sum(w**2) for w in weights])
    slow, fast = (Transform(window=window, n_points=n, n_bins=n) for n in samples.shape)
    assert to_decibels(snr_gain_in_map(fast, slow) / gain) == pytest.approx(0, abs=5e-4)
    assert motion_at_mid_frame(REFERENCE_TARGET).range_m == pytest.approx(50.00469, abs=1e-5)
