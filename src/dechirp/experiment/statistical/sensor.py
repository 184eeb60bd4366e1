"""A radar that draws its detections: no samples, no maps, thousands of frames in a second."""

import warnings
from functools import cached_property

import numpy as np
import xarray as xr
from scipy.special import gammaincc, gammainccinv

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.normal import add_white_noise
from dechirp.echoes.stages import by_stage
from dechirp.experiment.link import added_noise_w
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.statistical.arrivals import WEAKENS, Arrivals, arrivals
from dechirp.experiment.statistical.axis_law import AxisLaw, axis_law
from dechirp.experiment.statistical.peaks_drawn import (
    Alarms,
    Echoes,
    Rings,
    draw_peaks,
    numbers_needed,
)
from dechirp.experiment.statistical.ring_law import ring_law
from dechirp.experiment.statistical.told import told
from dechirp.process.cfar.base import Noise
from dechirp.process.detect import UNITS, labelled_detections
from dechirp.process.maps import left_by
from dechirp.process.mitigation.noise import searched
from dechirp.process.peaks import sidelobe_amplitude
from dechirp.process.spectrum import independent_rows
from dechirp.scene.fluctuation import power_factors
from dechirp.scene.surprises import surprises

# Frames at once: their scatterers and noise stay in the cache.
_FRAMES = 64
# An echo with less than this of what the noise of its cell varies by has no peak of its own, nor
# one that many standard deviations are short of its threshold: one in 1,000 would have.
_WEAK, _SHORT = 0.1, 5.0
# Frames whose truth is held at once, for as many scatterers as there are.
_HELD = 2**22


class Sensor:
    """Detections of a scenario, drawn trial by trial; made ready once.

    Of each scatterer in each frame the amplitudes in all channels are known, and so is what they
    add up to in the cells about it; the noise of these cells, of the ring about them and of the
    estimates is drawn from their joint law. From the amplitudes that were drawn, folds and
    directions are found as they are from those of samples, by the same functions. False alarms
    come on top, as many as the law of the detector has.

    Notes
    -----
    Approximated: a target keeps its range, velocity and acceleration of mid-frame within a frame,
    and what it walks or accelerates weakens it but does not widen its peak. Noise in cells is
    independent of that in the ring, and from target to target. Chirps of Swerling 2 and 4 keep
    their mean amplitude, without the noise that they leave over velocity. Powers of other
    targets in a ring are added to it in the mean. Estimates are one step of Newton's from the
    truth of the strongest scatterer in the cell: of the refinements that end on a wrong hill (one
    in 100 under a rectangular window, with a Hann window one in 1,000) none is drawn. Tones that
    refinement parts are parted exactly. Ratios of false alarms are about 1 dB low in the median.

    With a Hann window, steady or Swerling 1, before 1 and 8 elements, probabilities of detection
    are within 0.02 of those of samples and root-mean-square errors within 10 %.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Prepare a scenario.

        Raises
        ------
        InvalidSetting
            If it is a recording, no white noise is added, or ramps or intervals differ.

        Warns
        -----
        PhysicsWarning
            Of what surprises in the scene, as `simulate` does, and of impairments and clean-up
            that are not modelled.
        """
        if scenario.scene is None or scenario.radar is None:
            raise InvalidSetting(
                "scenario.recording",
                got="a recording",
                need="a scene to draw detections of",
                fix="Give a scene and a radar.",
            )
        radar = scenario.radar
        frame = radar.frame
        if frame.modulation is not None or frame.n_intervals > 1:
            raise InvalidSetting(
                "scenario.radar.frame."
                + ("interval" if frame.modulation is None else "modulation"),
                got="intervals in turn" if frame.modulation is None else frame.modulation.kind(),
                need="ramps and frames that are alike, for detections that are drawn",
                fix="Simulate samples instead, or leave it out.",
            )
        stages = by_stage(scenario.impairments, radar)
        self._noise_w = added_noise_w(scenario, radar)
        if not 0 < self._noise_w < np.inf:
            raise InvalidSetting(
                "scenario.impairments",
                got="no white noise",
                need="thermal noise or white noise, which detections are drawn from",
                fix="Add an impairment of kind thermal-noise.",
            )
        for finding in surprises(scenario.scene, radar, n_frames=scenario.n_frames):
            warnings.warn(PhysicsWarning(finding), stacklevel=2)
        self._scenario, self._radar, self._scene = scenario, radar, scenario.scene
        self._chain = scenario.chain.fitted(radar)
        self._paths = tuple(one for one in stages.paths if isinstance(one, WEAKENS))
        noises = [one for one in stages.all if one.noise_power_w(self._scene, radar) > 0]
        left_out = [one.kind() for one in stages.all if one not in noises + list(self._paths)]
        left_out += [m.kind() for m in self._chain.mitigation if not m.filters_slow_time]
        if left_out:
            warnings.warn(PhysicsWarning(_not_modelled(left_out)), stacklevel=2)
        numbers = range(scenario.n_frames)
        self._times_s = np.array([frame.start_s(i) + frame.mid_frame_s for i in numbers])

    def detections(self, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """One trial: columns as of `process.detect.detect`, (n_detections,) each."""
        blocks = [self._block(first, rng) for first in range(0, len(self._times_s), _FRAMES)]
        return {name: np.concatenate([one[name] for one in blocks]) for name in UNITS}

    def _block(self, first: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        own = slice(first, min(first + _FRAMES, len(self._times_s)))
        seen = self._arrivals(own)
        n_frames = own.stop - own.start
        amplitude = self._fluctuated(seen.amplitude, rng)
        axes, rings, noise = self._axes, self._rings, self._noise
        loss = noise.over_range.noise_bandwidth_bins * noise.over_velocity.noise_bandwidth_bins
        energy = np.einsum("fsk,fsk->fs", amplitude, amplitude.conj()).real
        powers = energy * seen.in_cells**2 / (loss * noise.n_channels)
        least = np.min(rings.factors)
        reached = 1 + powers + _SHORT * np.sqrt((1 + 2 * powers) / noise.n_channels)
        can = (powers > _WEAK / np.sqrt(noise.n_channels)) & (reached > least)
        alarms = self._alarms(n_frames, rng)
        n_own = np.count_nonzero(can)
        white = np.zeros(
            (n_own + len(alarms.ring), numbers_needed(axes, noise.n_channels)), np.float32
        )
        add_white_noise(white, 1.0, rng)
        echoes = Echoes(seen.velocity, seen.row, amplitude, seen.in_cells, powers, can)
        ring_of = rng.integers(len(rings.statistic), size=n_own)
        drawn = draw_peaks(echoes, *axes, rings, alarms, self._searched, ring_of, white)
        columns = told(drawn, self._radar, self._chain)
        columns["frame"] = columns["frame"] + first
        columns["time"] = self._times_s[columns["frame"]]
        return columns

    def _fluctuated(self, amplitude: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        scene, n_sent = self._scene, self._radar.frame.n_sent
        if not scene.fluctuating:
            return amplitude
        factors = np.ones(amplitude.shape[:2], np.float32)
        for number in range(len(factors)):
            per_frame, per_chirp = power_factors(scene, n_sent, rng)
            factors[number] = np.sqrt(per_frame)
            if per_chirp is not None:
                factors[number] *= np.sqrt(per_chirp).mean(axis=0)
        return amplitude * factors[..., None]

    def _alarms(self, n_frames: int, rng: np.random.Generator) -> Alarms:
        """Cells of noise over threshold in each frame: as many as there are by chance."""
        counts = rng.poisson(self._n_alarms, n_frames)
        n = int(counts.sum())
        cells = self._cells[rng.integers(len(self._cells), size=n)] if n else np.empty(0, int)
        at = np.stack(np.divmod(cells, self._searched.shape[1]), axis=1).reshape(-1, 2)
        rings, n_channels = self._rings, self._noise.n_channels
        factors = rings.factors[at[:, 1]]
        ring = np.searchsorted(self._alarm_rings, rng.random(n))
        ring = np.minimum(ring, len(rings.statistic) - 1)
        rare = gammaincc(n_channels, n_channels * factors * rings.statistic[ring])
        power = gammainccinv(n_channels, rare * rng.random(n)) / n_channels
        first = np.concatenate([[0], np.cumsum(counts)])
        return Alarms(first, at, power, ring)

    def _arrivals(self, own: slice) -> Arrivals:
        if self._all is not None:
            return Arrivals(*(each[own] for each in self._all))
        return self._made(self._times_s[own])

    def _made(self, times_s: np.ndarray) -> Arrivals:
        return arrivals(self._scene, self._radar, self._chain, self._paths, times_s, self._noise_w)

    @cached_property
    def _all(self) -> Arrivals | None:
        """All frames where they are few enough to be kept."""
        held = len(self._times_s) * self._scene.n_scatterers * self._radar.n_summed
        return self._made(self._times_s) if held <= _HELD else None

    @cached_property
    def _noise(self) -> Noise:
        return self._chain.noise(self._radar)

    @cached_property
    def _axes(self) -> tuple[AxisLaw, AxisLaw]:
        return axis_law(self._noise.over_velocity), axis_law(self._noise.over_range)

    @cached_property
    def _searched(self) -> np.ndarray:
        """Cells in which a peak may be, (n_velocity, n_rows)."""
        left = left_by(self._radar, self._chain)
        within = np.zeros((self._noise.over_velocity.n_bins, self._rings.factors.size), bool)
        within[:, np.isfinite(self._rings.factors)] = True
        return within if left is None else within & searched(left)

    @cached_property
    def _cells(self) -> np.ndarray:
        return np.flatnonzero(self._searched)

    @cached_property
    def _rings(self) -> Rings:
        chirp, cfar, noise = self._radar.frame.chirp, self._chain.cfar, self._noise
        rows = independent_rows(chirp, noise.over_range)
        n_bins = noise.over_range.n_bins
        n_rows = n_bins if chirp.sampling == "complex" else n_bins // 2 + 1
        n_within = rows.stop - rows.start
        level = np.ones((noise.over_velocity.n_bins, n_within), np.float32)
        at = np.stack([np.zeros(n_within, int), np.arange(n_within)], axis=1)
        factors = np.full(n_rows, np.inf)
        factors[rows] = cfar.threshold_at(level, at, noise)
        ring, (over_velocity, over_range) = cfar.ring, self._axes
        n_training, shifts = np.ones(n_rows), np.zeros(n_rows)
        n_training[rows] = ring.n_cells(n_within)
        shifts[rows] = ring.half_range - ring.places(n_within)
        law = ring_law(cfar, noise)
        return Rings(
            statistic=law.statistic,
            corners=law.corners,
            sensitivity=law.sensitivity,
            factors=factors,
            n_training=n_training,
            shifts=shifts,
            box=(over_velocity.energy(ring.half_velocity), over_range.energy(ring.half_range)),
            guard=(
                over_velocity.energy(ring.n_guard.velocity),
                over_range.energy(ring.n_guard.range),
            ),
            sidelobes=(
                sidelobe_amplitude(noise.over_velocity),
                sidelobe_amplitude(noise.over_range),
            ),
        )

    @cached_property
    def _rare(self) -> np.ndarray:
        """Probability that noise exceeds its threshold in each draw of the ring."""
        n_channels, rings = self._noise.n_channels, self._rings
        factor = np.median(rings.factors[np.isfinite(rings.factors)])
        return np.asarray(gammaincc(n_channels, n_channels * factor * rings.statistic))

    @cached_property
    def _alarm_rings(self) -> np.ndarray:
        """Of alarms, how likely they come with the first so many draws of the ring."""
        return np.asarray(np.cumsum(self._rare) / np.sum(self._rare))

    @cached_property
    def _n_alarms(self) -> float:
        """Cells over threshold in a frame of noise, in the mean."""
        stated = self._chain.cfar.false_alarm_probability
        return len(self._cells) * (float(np.mean(self._rare)) if stated is None else stated)


def sense(scenario: Scenario, *, seed: int | np.random.Generator | None = None) -> xr.Dataset:
    """Detections of a scenario, drawn without samples: a table as `process.detect.detect` gives.

    `seed`: an int or a Generator; that of the scenario without it. See `Sensor` for what is
    exact and what is approximated, and for what it raises and warns of.
    """
    rng = seed if isinstance(seed, np.random.Generator) else None
    if rng is None:
        rng = np.random.default_rng(scenario.seed if seed is None else seed)
    columns = Sensor(scenario).detections(rng)
    return labelled_detections(columns)


def _not_modelled(kinds: list[str]) -> Finding:
    return Finding(
        level="warning",
        setting="impairments",
        got=f"{', '.join(kinds)}, which detections that are drawn know nothing of",
        need="white noise, and on the paths rain, fog and gas",
        fix="Simulate samples for what else matters.",
    )
