"""Claims on impairments, gathered: what is measured of each member of the family."""

from collections.abc import Mapping

import numpy as np

from dechirp.experiment.verify.claim import Part
from dechirp.experiment.verify.impairments import noises, oscillators, receivers, ways, weather
from dechirp.experiment.verify.trials import Job

MEASUREMENTS = tuple(
    sorted(
        (
            *oscillators.MEASUREMENTS,
            *ways.MEASUREMENTS,
            *weather.MEASUREMENTS,
            *noises.MEASUREMENTS,
            *receivers.MEASUREMENTS,
        ),
        key=lambda one: one.kind,
    )
)
"""By kind. Every member of the family has one: a test sees to it."""


def jobs() -> dict[str, Job]:
    """Trials of all of them."""
    return {one.name: one.job() for one in MEASUREMENTS}


def part(results: Mapping[str, np.ndarray]) -> Part:
    """The claims of these measurements, one for each impairment."""
    return Part(
        id="impairments",
        title="Every impairment against its formula",
        how="Each impairment of the package acts on simulated samples of a radar at 77 GHz with a"
        " ramp of 20 MHz a microsecond, 10 MHz of complex samples and two receivers. The figure"
        " that its formula gives is read off the samples, with echoes of the same scene without"
        " it beside them. Where noise is involved it is a mean over trials with an interval.",
        claims=tuple(one.judged(results) for one in MEASUREMENTS),
    )
