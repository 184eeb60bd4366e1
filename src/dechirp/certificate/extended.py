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
from dechirp.certificate.trials import Job, count_blocks

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


def initial_jobs(n_trials: int) -> dict[str, Job]:
    """Return the jobs of all parts that do not depend on the results of others."""
    return {
        **every_detector.calibration_jobs(),
        **directions.trial_jobs(n_trials),
        **{
            measurement.job_name: measurement.trial_job() for measurement in IMPAIRMENT_MEASUREMENTS
        },
    }


def count_noise_map_blocks() -> int:
    """Return the number of blocks of `noise_map_jobs`."""
    return count_blocks(every_detector.trial_jobs(None, every_detector.MIN_CELLS))


def noise_map_jobs(results: Mapping[str, np.ndarray]) -> dict[str, Job]:
    """Return the jobs that count alarms in noise maps, given the factors from `initial_jobs`."""
    return every_detector.trial_jobs(results, every_detector.MIN_CELLS)


def build_parts(results: Mapping[str, np.ndarray]) -> tuple[Part, ...]:
    """Return all parts, given the results of all jobs."""
    return (
        every_detector.build_part(results),
        directions.build_part(results),
        _impairment_part(results),
    )


def _impairment_part(results: Mapping[str, np.ndarray]) -> Part:
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
