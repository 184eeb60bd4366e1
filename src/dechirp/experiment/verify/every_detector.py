"""Claims on false alarms of every detector under every window, in every cell of a map.

Members of the family are discovered, each with the options that it has by default; one that
cannot do without options is left out. All of them judge the same maps, which are made of samples
by the transforms of the chain: noise and transforms cost as much as one detector does.
"""

from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from typing import get_args

import numpy as np

from dechirp.core.values import value
from dechirp.experiment.verify.claim import Check, Claim, Part
from dechirp.experiment.verify.false_alarms import over_design
from dechirp.experiment.verify.looks import named, radar, white_noise
from dechirp.experiment.verify.trials import Job
from dechirp.process.cfar.base import Cfar, NoiseEstimator
from dechirp.process.chain import Chain
from dechirp.process.maps import power_of
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window

PFA = 1e-5
"""Design. Of 1e9 cells 10,000 alarm: by themselves they have an interval of 4.4 %, in clusters
of three 8 %. At 1e-6 it would be as wide as what is required; 1e-4 is far from what is used."""
CELLS = 1.0e9
"""Tested for each detector and window, at least."""
N_SAMPLES = 256
"""Of a chirp, and rows of a map: a ninth of them has its training cells moved at the ends."""
PADDED = 2
"""Rows of a padded map over those that are not."""


@value
class NoiseMaps:
    """Maps of noise of one kind."""

    window: Window
    n_range_bins: int

    @property
    def name(self) -> str:
        """What tells it from the others."""
        padded = "" if self.n_range_bins == N_SAMPLES else f" padded to {self.n_range_bins}"
        return f"{named(self.window)}{padded}"

    @property
    def chain(self) -> Chain:
        """The chain that makes them."""
        return Chain(
            range_window=self.window, doppler_window=self.window, n_range_bins=self.n_range_bins
        )

    @property
    def n_cells(self) -> int:
        """Of one of them."""
        return self.n_range_bins * radar().frame.n_chirps


_UNPADDED = tuple(NoiseMaps(window=w, n_range_bins=N_SAMPLES) for w in get_args(Window))
_WITH_PADDING: tuple[NoiseMaps, ...] = (
    NoiseMaps(window="rectangular", n_range_bins=PADDED * N_SAMPLES),
    NoiseMaps(window="hann", n_range_bins=PADDED * N_SAMPLES),
)
GROUPS = {"maps of noise": _UNPADDED, "padded maps of noise": _WITH_PADDING}
"""Maps that are made of the same noise."""


def detectors() -> dict[str, Cfar]:
    """Members of the family at the design, by kind."""
    return {
        kind: Cfar(estimator=member(), false_alarm_probability=PFA)
        for kind, member in NoiseEstimator.members().items()
        if all(field.default is not MISSING for field in fields(member))
    }


def small_radar() -> Radar:
    """The reference radar with fewer samples: maps that stay in the cache."""
    chirp = replace(radar().frame.chirp, n_samples=N_SAMPLES)
    return replace(radar(), frame=replace(radar().frame, chirp=chirp))


def factor_jobs() -> dict[str, Job]:
    """Calibrations, which take seconds each: done once, for all workers."""
    return {
        _calibration(maps, kind): Job(
            work=factors, n_trials=1, told={"maps": maps, "cfar": cfar}, n_each=1
        )
        for of_group in GROUPS.values()
        for maps in of_group
        for kind, cfar in detectors().items()
    }


def factors(rng: np.random.Generator, n_trials: int, *, maps: NoiseMaps, cfar: Cfar) -> np.ndarray:
    """Factor of each row of a map, (1, n_range)."""
    size = np.empty((radar().frame.n_chirps, maps.n_range_bins), np.float32)
    return cfar.factor_of_rows(size, maps.chain.noise(small_radar()))[None]


def _calibration(maps: NoiseMaps, kind: str) -> str:
    return f"factor of {kind}, {maps.name}"


def jobs(found: Mapping[str, np.ndarray] | None, cells: float) -> dict[str, Job]:
    """Frames of noise, so many that each detector has `cells` under each window.

    `found`: results of `factor_jobs`; without them the jobs can be counted, not run.
    """
    judged = detectors() if found is not None else {}
    return {
        name: Job(
            work=alarms,
            n_trials=max(2, int(np.ceil(cells / min(maps.n_cells for maps in of_group)))),
            told={
                "group": of_group,
                "judges": [
                    [
                        (cfar, (found or {})[_calibration(maps, kind)][0])
                        for kind, cfar in judged.items()
                    ]
                    for maps in of_group
                ],
            },
            n_each=64,
        )
        for name, of_group in GROUPS.items()
    }


def alarms(
    rng: np.random.Generator,
    n_trials: int,
    *,
    group: tuple[NoiseMaps, ...],
    judges: list[list[tuple[Cfar, np.ndarray]]],
) -> np.ndarray:
    """False alarms in each frame, (n_trials, maps, detectors, 2): all, and at the ends of range."""
    seen = small_radar()
    shape = (seen.frame.n_chirps, 1, seen.frame.chirp.n_samples)
    counts = np.empty((n_trials, len(group), len(judges[0]), 2), np.uint16)
    for trial in range(n_trials):
        samples = white_noise(rng, shape)
        for of_trial, maps, of_map in zip(counts[trial], group, judges, strict=True):
            power = power_of(samples, seen, maps.chain)
            for of_detector, (cfar, rows) in zip(of_trial, of_map, strict=True):
                over = cfar.estimator.exceeds(power, cfar.ring, rows)
                half = cfar.ring.half_range
                n_over = np.count_nonzero(over)
                of_detector[:] = n_over, n_over - np.count_nonzero(over[:, half:-half])
    return counts


def part(results: Mapping[str, np.ndarray]) -> Part:
    """The claims of this file: one for each detector."""
    return Part(
        id="false_alarms",
        title="False alarms of every detector",
        how="Every detector of the package judges maps of noise alone, every cell of them, the"
        " ends of the range included. The maps are made of samples by the transforms of the"
        " chain, under each window of the package over range and velocity, and padded with zeros"
        " under two of them. Figures are false alarms over those of the design.",
        claims=tuple(_claim(at, kind, results) for at, kind in enumerate(detectors())),
    )


def _claim(at: int, kind: str, results: Mapping[str, np.ndarray]) -> Claim:
    checks: list[Check] = []
    at_ends = []
    for name, of_group in GROUPS.items():
        counts = results[name][:, :, at].astype(float)
        for place, maps in enumerate(of_group):
            checks.append(_over(maps.name, counts[:, place, 0], PFA, maps.n_cells))
        at_ends.append(counts[:, :, 1].sum(axis=1))
    # Rows about which the box of training cells cannot be centred, of all unpadded maps.
    half = detectors()[kind].ring.half_range
    n_ends = 2 * half * radar().frame.n_chirps * len(next(iter(GROUPS.values())))
    checks.append(_over("at both ends of the range, all windows", at_ends[0], PFA, n_ends))
    return Claim(
        id=f"false_alarms_{kind.replace('-', '_')}",
        claim=f"The {kind} detector alarms as often as asked for under every window, within a"
        " factor of 1.25.",
        checks=tuple(checks),
    )


def _over(name: str, counts: np.ndarray, probability: float, n_cells: int) -> Check:
    check = over_design(name, counts, probability * n_cells)
    return replace(check, trials=n_cells * counts.size)
