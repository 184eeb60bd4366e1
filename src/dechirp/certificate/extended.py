"""Claims of a full certificate beyond the reference report."""

from collections.abc import Mapping

import numpy as np

from dechirp.certificate import directions, every_detector
from dechirp.certificate.claim import Part
from dechirp.certificate.impairments import (
    oscillators,
    propagation,
    receiver_noise,
    receivers,
    weather,
)
from dechirp.certificate.trials import Job, count_trial_blocks

IMPAIRMENT_MEASUREMENTS = tuple(
    sorted(
        (
            *oscillators.MEASUREMENTS,
            *propagation.MEASUREMENTS,
            *weather.MEASUREMENTS,
            *receiver_noise.MEASUREMENTS,
            *receivers.MEASUREMENTS,
        ),
        key=lambda measurement: measurement.kind,
    )
)
"""Measurements of impairments, sorted by kind. A test demands one for each impairment."""


def calibration_direction_impairment_jobs(n_trials: int) -> dict[str, Job]:
    """Return the jobs of all parts that do not depend on the results of others."""
    return {
        **every_detector.threshold_calibration_jobs(),
        **directions.one_and_two_source_trial_jobs(n_trials),
        **{
            measurement.job_name: measurement.trial_job() for measurement in IMPAIRMENT_MEASUREMENTS
        },
    }


def count_noise_map_trial_blocks() -> int:
    """Return the number of blocks of `noise_map_false_alarm_jobs`."""
    return count_trial_blocks(
        every_detector.false_alarm_counting_jobs(None, every_detector.MIN_CELLS)
    )


def noise_map_false_alarm_jobs(results: Mapping[str, np.ndarray]) -> dict[str, Job]:
    """Return the jobs that count alarms in noise maps, given the results of the first jobs."""
    return every_detector.false_alarm_counting_jobs(results, every_detector.MIN_CELLS)


def build_claims_beyond_report(results: Mapping[str, np.ndarray]) -> tuple[Part, ...]:
    """Return all parts, given the results of all jobs."""
    return (
        every_detector.build_false_alarm_rate_claims(results),
        directions.build_direction_claims(results),
        _build_impairment_claims(results),
    )


def _build_impairment_claims(results: Mapping[str, np.ndarray]) -> Part:
    """Return the claims on impairments, one for each."""
    return Part(
        id="impairments",
        title="Every impairment against its formula",
        method="Each impairment of the package is applied to simulated samples of a 77 GHz radar"
        " with ramps of 20 MHz/µs, complex samples at 10 MS/s and two receivers. The quantity that"
        " its formula predicts is measured on the samples and, where necessary, compared with the"
        " echoes of the same scene without the impairment. Measurements with noise are means over"
        " trials, with an interval.",
        claims=tuple(
            measurement.evaluate_claim(results) for measurement in IMPAIRMENT_MEASUREMENTS
        ),
    )
