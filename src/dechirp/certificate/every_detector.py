"""Claims on the false-alarm rate of every detector with every window, in all cells of a map.

All members of the CFAR family are measured with their default options; a member without defaults is
left out. All detectors process the same maps, because noise and transforms take as long as one
detector.
"""

from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from typing import get_args

import numpy as np

from dechirp.certificate.claim import Check, Claim, Part
from dechirp.certificate.false_alarms import false_alarm_ratio_check
from dechirp.certificate.reference_trials import complex_white_noise, reference_radar, window_label
from dechirp.certificate.trials import Job
from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import Cfar, NoiseEstimator
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window

FALSE_ALARM_PROBABILITY = 1e-5
"""Designed false-alarm probability.

1e9 cells give 10,000 false alarms with an interval of 4.4 % if they are independent, 8 % in
clusters of three. At 1e-6 the interval would be as wide as the requirement; 1e-4 is uncommon in
practice.
"""
MIN_CELLS = 1.0e9
"""Minimum number of tested cells of each detector and window."""
N_SAMPLES = 256
"""Samples per chirp and range bins; in a ninth of them the training window is shifted."""
PADDING_FACTOR = 2
"""Zero-padding factor of the range transform of padded maps."""


@frozen_dataclass
class NoiseMaps:
    """Window and size of noise maps of one kind."""

    window: Window
    n_range_bins: int

    @property
    def name(self) -> str:
        """Name of the maps in checks."""
        padded = "" if self.n_range_bins == N_SAMPLES else f" padded to {self.n_range_bins}"
        return f"{window_label(self.window)}{padded}"

    @property
    def chain(self) -> Chain:
        """Chain that computes the maps."""
        return Chain(
            range_window=self.window, doppler_window=self.window, n_range_bins=self.n_range_bins
        )

    @property
    def n_cells(self) -> int:
        """Number of cells of one map."""
        return self.n_range_bins * reference_radar().frame.n_chirps


_UNPADDED = tuple(NoiseMaps(window=w, n_range_bins=N_SAMPLES) for w in get_args(Window))
_PADDED: tuple[NoiseMaps, ...] = (
    NoiseMaps(window="rectangular", n_range_bins=PADDING_FACTOR * N_SAMPLES),
    NoiseMaps(window="hann", n_range_bins=PADDING_FACTOR * N_SAMPLES),
)
MAP_GROUPS = {"maps of noise": _UNPADDED, "padded maps of noise": _PADDED}
"""Maps computed from the same noise, by job name."""


def cfar_detectors_by_kind() -> dict[str, Cfar]:
    """Return all CFAR detectors with the designed false-alarm probability, by kind."""
    return {
        kind: Cfar(estimator=member(), false_alarm_probability=FALSE_ALARM_PROBABILITY)
        for kind, member in NoiseEstimator.members().items()
        if all(field.default is not MISSING for field in fields(member))
    }


def reference_radar_with_fewer_samples() -> Radar:
    """Return the reference radar with fewer samples, so that maps fit in the cache."""
    chirp = replace(reference_radar().frame.chirp, n_samples=N_SAMPLES)
    return replace(reference_radar(), frame=replace(reference_radar().frame, chirp=chirp))


def threshold_calibration_jobs() -> dict[str, Job]:
    """Return the jobs that calibrate the detectors once for all workers; each takes seconds."""
    return {
        _calibration_job_name(maps, kind): Job(
            work=threshold_factors_per_range_bin,
            n_trials=1,
            arguments={"maps": maps, "cfar": cfar},
            block_size=1,
        )
        for group in MAP_GROUPS.values()
        for maps in group
        for kind, cfar in cfar_detectors_by_kind().items()
    }


def threshold_factors_per_range_bin(
    rng: np.random.Generator, n_trials: int, *, maps: NoiseMaps, cfar: Cfar
) -> np.ndarray:
    """Return the threshold factor of each range bin, (1, n_range)."""
    size = np.empty((reference_radar().frame.n_chirps, maps.n_range_bins), np.float32)
    return cfar.threshold_factors_per_row(
        size, maps.chain.map_noise_statistics(reference_radar_with_fewer_samples())
    )[None]


def _calibration_job_name(maps: NoiseMaps, detector_kind: str) -> str:
    return f"factor of {detector_kind}, {maps.name}"


def false_alarm_counting_jobs(
    factors: Mapping[str, np.ndarray] | None, min_cells: float
) -> dict[str, Job]:
    """Return the jobs that count false alarms in at least `min_cells` of each detector and window.

    `factors`: results of `threshold_calibration_jobs`; without them the jobs can be counted, not
    run.
    """
    detectors = cfar_detectors_by_kind() if factors is not None else {}
    return {
        name: Job(
            work=count_false_alarms_per_frame,
            n_trials=max(2, int(np.ceil(min_cells / min(maps.n_cells for maps in group)))),
            arguments={
                "map_kinds": group,
                "detectors_per_map": [
                    [
                        (cfar, (factors or {})[_calibration_job_name(maps, kind)][0])
                        for kind, cfar in detectors.items()
                    ]
                    for maps in group
                ],
            },
            block_size=64,
        )
        for name, group in MAP_GROUPS.items()
    }


def count_false_alarms_per_frame(
    rng: np.random.Generator,
    n_trials: int,
    *,
    map_kinds: tuple[NoiseMaps, ...],
    detectors_per_map: list[list[tuple[Cfar, np.ndarray]]],
) -> np.ndarray:
    """Count false alarms per frame, (n_trials, maps, detectors, 2): all, and at the range ends."""
    radar = reference_radar_with_fewer_samples()
    shape = (radar.frame.n_chirps, 1, radar.frame.chirp.n_samples)
    counts = np.empty((n_trials, len(map_kinds), len(detectors_per_map[0]), 2), np.uint16)
    for trial in range(n_trials):
        samples = complex_white_noise(rng, shape)
        for trial_counts, maps, calibrated_detectors in zip(
            counts[trial], map_kinds, detectors_per_map, strict=True
        ):
            power = range_doppler_power(samples, radar, maps.chain)
            for detector_counts, (cfar, factor) in zip(
                trial_counts, calibrated_detectors, strict=True
            ):
                exceeds = cfar.estimator.exceeds_threshold(power, cfar.training_window, factor)
                half = cfar.training_window.half_range
                n_alarms = np.count_nonzero(exceeds)
                detector_counts[:] = n_alarms, n_alarms - np.count_nonzero(exceeds[:, half:-half])
    return counts


def build_false_alarm_rate_claims(results: Mapping[str, np.ndarray]) -> Part:
    """Return the claims on the false-alarm rate, one for each detector."""
    return Part(
        id="false_alarms",
        title="False-alarm rate of every detector",
        method="Every detector of the package processes all cells of noise maps, including the ends"
        " of the range axis. The maps are computed from samples by the transforms of the chain,"
        " with"
        " each window of the package over range and velocity, and with zero padding for two of"
        " them."
        " Values are measured over designed false-alarm rates.",
        claims=tuple(
            _detector_false_alarm_rate_claim(index, kind, results)
            for index, kind in enumerate(cfar_detectors_by_kind())
        ),
    )


def _detector_false_alarm_rate_claim(
    detector_index: int, kind: str, results: Mapping[str, np.ndarray]
) -> Claim:
    checks: list[Check] = []
    end_counts = []
    for name, group in MAP_GROUPS.items():
        counts = results[name][:, :, detector_index].astype(float)
        for map_index, maps in enumerate(group):
            checks.append(
                _false_alarm_ratio_check_over_cells(
                    maps.name, counts[:, map_index, 0], FALSE_ALARM_PROBABILITY, maps.n_cells
                )
            )
        end_counts.append(counts[:, :, 1].sum(axis=1))
    # Cells of all unpadded maps on which the training window cannot be centred.
    half = cfar_detectors_by_kind()[kind].training_window.half_range
    n_end_cells = 2 * half * reference_radar().frame.n_chirps * len(next(iter(MAP_GROUPS.values())))
    checks.append(
        _false_alarm_ratio_check_over_cells(
            "both ends of the range axis, all windows",
            end_counts[0],
            FALSE_ALARM_PROBABILITY,
            n_end_cells,
        )
    )
    return Claim(
        id=f"false_alarms_{kind.replace('-', '_')}",
        claim=f"The false-alarm rate of the {kind} detector is that of the design with every"
        " window,"
        " within a factor of 1.25.",
        checks=tuple(checks),
    )


def _false_alarm_ratio_check_over_cells(
    name: str, counts: np.ndarray, probability: float, n_cells: int
) -> Check:
    check = false_alarm_ratio_check(name, counts, probability * n_cells)
    return replace(check, trials=n_cells * counts.size)
