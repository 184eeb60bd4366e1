"""Extended certificate of `--full`: coverage of all families, and failure of worse results."""

from dataclasses import replace

import numpy as np
import pytest

from dechirp.certificate import directions, every_detector, extended
from dechirp.certificate.directions import (
    run_error_over_bound_trials,
    run_two_source_resolution_trials,
)
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
from dechirp.theory.bounds import crlb_angle
from dechirp.theory.windows import window_weights
from nightly import nightly_except

MEASUREMENTS_BY_KIND = {entry.kind: entry for entry in extended.IMPAIRMENT_MEASUREMENTS}


def test_every_family_member_is_certified():
    assert set(MEASUREMENTS_BY_KIND) == set(Impairment.members())
    assert set(every_detector.cfar_detectors_by_kind()) == set(NoiseEstimator.members())
    estimators = {name.rpartition(", ")[2] for name in directions.one_and_two_source_trial_jobs(1)}
    assert estimators == set(DirectionEstimator.members())


# Random impairments have four trials instead of many, so the tolerance is four times as large.
@pytest.mark.parametrize("kind", nightly_except(10, sorted(MEASUREMENTS_BY_KIND)))
def test_impairment_matches_its_formula(kind):
    measurement = MEASUREMENTS_BY_KIND[kind]
    if measurement.n_trials > 1:
        results = [measurement.measure(np.random.default_rng(seed)) for seed in range(4)]
        tolerances = 4 * np.array([quantity.tolerance for quantity in measurement.quantities])
    else:
        results = [measurement.measure(np.random.default_rng(0))]
        tolerances = np.array([quantity.tolerance for quantity in measurement.quantities])
    measured, formula = np.mean(results, axis=0).T
    assert np.all(abs(measured - formula) <= tolerances)


@pytest.mark.parametrize(
    ("bias", "passes"), [(0.0, True), (0.04, True), (0.11, False), (-0.11, False), (np.nan, False)]
)
def test_measurement_beyond_tolerance_fails(bias, passes):
    measurement = Measurement(
        kind="made-up",
        claim="A number is three.",
        quantities=(Quantity(name="number", unit="dB", tolerance=0.1),),
        measure=lambda rng: ((3.0 + bias + 0.03 * rng.standard_normal(), 3.0),),
        n_trials=64,
    )
    job = measurement.trial_job()
    trials = job.work(np.random.default_rng(1), 64, **job.arguments)
    claim = measurement.evaluate_claim({measurement.job_name: trials})
    assert claim.passed == passes
    assert (claim.id, claim.checks[0].limit) == ("impairment_made_up", 3.0)


def test_direction_bound_matches_linear_array_bound():
    rng = np.random.default_rng(2)
    array, azimuth = directions.half_wavelength_linear_array(), rng.uniform(-1, 1, (5, 1))
    amplitudes = np.exp(1j * rng.uniform(0, 6, (5, 1)))
    bound = directions.azimuth_cramer_rao_bounds_rad(array, azimuth, amplitudes, 0.01)
    expected = crlb_angle(
        snr=100.0, positions_m=array.positions[:, 1], wavelength_m=1.0, angle_rad=azimuth
    )
    np.testing.assert_allclose(bound, expected, rtol=1e-9)


@pytest.mark.parametrize("kind", sorted(DirectionEstimator.members()))
def test_direction_trials_have_errors_near_their_bounds(kind):
    member = DirectionEstimator.members()[kind]
    trials = run_error_over_bound_trials(np.random.default_rng(3), 300, estimator=member())
    # The RMS of 300 trials has a standard error of 4 %; the tolerance is five of them.
    assert np.sqrt(np.mean((trials[:, 0] / trials[:, 1]) ** 2)) == pytest.approx(1, abs=0.2)
    two_source_estimator = directions._two_source_estimator_or_none(member)
    if two_source_estimator is not None:
        separation = 2 * directions.BEAMWIDTH
        pair_trials = run_two_source_resolution_trials(
            np.random.default_rng(4), 40, estimator=two_source_estimator, separation=separation
        )
        assert pair_trials.mean(axis=0) == pytest.approx([1.0, 1.0])


def make_direction_results(rng, *, errors=1.0, stated_error=1.0, loss_rate=0.0):
    n = 10_000
    results = {}
    for name in directions.one_and_two_source_trial_jobs(1):
        if name.startswith("one"):
            results[name] = np.stack(
                [errors * rng.standard_normal(n), np.full(n, stated_error)], axis=1
            )
        else:
            results[name] = np.stack([rng.random(n) >= loss_rate, np.ones(n)], axis=1)
    return results


@pytest.mark.parametrize(
    ("changes", "passes"),
    [
        ({}, True),
        ({"errors": 1.3, "stated_error": 1.3}, True),  # less accurate, as stated
        ({"errors": 1.15}, False),  # stated errors too small
        ({"errors": 0.9, "stated_error": 0.9}, False),  # better than the bound
        ({"loss_rate": 0.2}, False),
        ({"errors": np.nan}, False),
    ],
    ids=str,
)
def test_direction_estimator_worse_than_stated_fails(changes, passes):
    results = make_direction_results(np.random.default_rng(5), **changes)
    assert {claim.passed for claim in directions.build_direction_claims(results).claims} >= {passes}
    if passes:
        assert all(claim.passed for claim in directions.build_direction_claims(results).claims)


def make_noise_results(rng, rate_factors):
    """Make alarm counts of noise frames for detectors with the given false-alarm rates."""
    results = {}
    for name, job in every_detector.false_alarm_counting_jobs(
        None, every_detector.MIN_CELLS
    ).items():
        group = every_detector.MAP_GROUPS[name]
        shape = (job.n_trials, len(group), len(rate_factors))
        cells = np.array([maps.n_cells for maps in group])[:, None]
        ends = 28 * reference_radar().frame.n_chirps
        mean = every_detector.FALSE_ALARM_PROBABILITY * np.array(rate_factors)
        at_ends = rng.poisson(mean * ends, shape)
        results[name] = np.stack([rng.poisson(mean * (cells - ends), shape) + at_ends, at_ends], -1)
    return results


def test_detector_with_wrong_false_alarm_rate_fails():
    rate_factors = [1.0, 1.1, 1.3, 0.75, 0.9, 1.0]
    results = make_noise_results(np.random.default_rng(6), rate_factors)
    claims = every_detector.build_false_alarm_rate_claims(results).claims
    assert [claim.passed for claim in claims] == [
        0.8 < rate_factor < 1.25 for rate_factor in rate_factors
    ]
    # Ten thousand alarms give a half width of 4.4 %, as designed.
    check = claims[0].checks[0]
    assert check.trials >= 1e9
    assert (check.high - check.low) / 2 == pytest.approx(0.044, abs=0.003)


def test_alarm_counts_match_those_of_chain():
    maps = every_detector.NoiseMaps(window="rectangular", n_range_bins=every_detector.N_SAMPLES)
    cfar = replace(
        every_detector.cfar_detectors_by_kind()["greatest-of"], false_alarm_probability=1e-2
    )
    rows = every_detector.threshold_factors_per_range_bin(
        np.random.default_rng(0), 1, maps=maps, cfar=cfar
    )[0]
    counts = every_detector.count_false_alarms_per_frame(
        np.random.default_rng(7), 2, map_kinds=(maps,), detectors_per_map=[[(cfar, rows)]]
    )

    rng, radar = np.random.default_rng(7), every_detector.reference_radar_with_fewer_samples()
    chain = replace(maps.chain, cfar=cfar)
    for n_alarms, n_edge_alarms in counts[:, 0, 0]:
        samples = every_detector.complex_white_noise(rng, (128, 1, 256))
        power = range_doppler_power(samples, radar, chain)
        exceeds_threshold = power > cfar.threshold(power, chain.map_noise_statistics(radar))
        assert n_alarms == exceeds_threshold.sum() > 200
        assert n_edge_alarms == exceeds_threshold[:, :14].sum() + exceeds_threshold[:, -14:].sum()


# Theory assumes a tone; range walk of the echo by 0.06 cells costs 0.0001 dB. A Doppler frequency
# that ignores the lower transmit frequency at the delay (by 9e-5) gives an error of 0.002 dB.
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_snr_gain_in_map_matches_reference_echo(window):
    samples = unit_power_echo(*REFERENCE_TARGET).values[0, :, 0].astype(np.complex128)
    weights = [window_weights(window, n) for n in samples.shape]
    power = abs(np.fft.fft2(samples * np.outer(*weights))) ** 2
    gain = power.max() / np.mean(abs(samples) ** 2) / np.prod([np.sum(w**2) for w in weights])
    slow, fast = (Transform(window=window, n_points=n, n_bins=n) for n in samples.shape)
    assert to_decibels(snr_gain_in_map(fast, slow) / gain) == pytest.approx(0, abs=5e-4)
    assert motion_at_mid_frame(REFERENCE_TARGET).range_m == pytest.approx(50.00469, abs=1e-5)
