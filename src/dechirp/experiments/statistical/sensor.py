"""Statistical sensor: draws detections without samples or maps, thousands of frames a second."""

import warnings
from functools import cached_property

import numpy as np
import scipy
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.detection_columns import UNITS, detections_from_columns
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.experiments.link_budget import added_noise_power_w
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.statistical.axis_statistics import (
    AxisStatistics,
    tabulate_lobe_and_noise_statistics,
)
from dechirp.experiments.statistical.detections import detections_from_sampled_peaks
from dechirp.experiments.statistical.peak_sampling import (
    FrameEchoes,
    NoiseAlarms,
    TrainingWindows,
    max_normal_numbers_per_candidate,
    sample_peaks,
)
from dechirp.experiments.statistical.received_echoes import (
    ATTENUATIONS,
    ReceivedEchoes,
    compute_received_echoes,
)
from dechirp.experiments.statistical.training_statistics import draw_training_window_statistics
from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.mitigation.noise_loss import sufficient_noise_gain_mask
from dechirp.processing.peaks import sidelobe_envelope
from dechirp.processing.range_doppler_map import residual_noise_gain
from dechirp.processing.spectrum import rows_with_circular_noise
from dechirp.scene.fluctuation import draw_fluctuation_factors
from dechirp.scene.scene import Scene
from dechirp.scene.scene_warnings import scene_findings
from dechirp.simulation.stages import sort_into_stages

# Frames per block: their scatterers and noise fit into the cache.
_FRAMES_PER_BLOCK = 64
# Echoes weaker than this share of the noise deviation of a cell, or this many deviations below
# the threshold, form no peak: one in 1,000 would.
_MIN_ECHO, _MAX_SHORTFALL_STD = 0.1, 5.0
# Largest number of cached echo amplitudes, over frames, scatterers and channels.
_MAX_CACHED_VALUES = 2**22


class StatisticalSensor:
    """Draw the detections of a scenario, trial by trial.

    The amplitudes of each scatterer in each frame are known in all channels, and so is their sum in
    the cells about it; the noise of these cells, of their training window and of the estimates is
    drawn from their joint law. Velocity ambiguity and directions follow from the sampled amplitudes
    by the functions that process samples. False alarms are added at the rate of the detector's law.

    Notes
    -----
    Approximations: a target keeps its range, velocity and acceleration of mid-frame within a frame,
    and range walk and acceleration attenuate it but do not widen its peak. Noise in cells is
    independent of that in the training window, and from target to target. Chirps of Swerling 2 and
    4 keep their mean amplitude, without the noise that they leave over velocity. Powers of other
    targets in a training window are added to it in the mean. Estimates are one Newton step from the
    truth of the strongest scatterer in the cell: refinements that end on a wrong maximum (one
    in 100 under a rectangular window, with a Hann window one in 1,000) are not drawn. Tones that
    refinement separates are separated exactly. Ratios of false alarms are about 1 dB low in the
    median.

    With a Hann window, steady or Swerling 1, with 1 and 8 elements, probabilities of detection
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
            Of findings on the scene, as `simulate` does, and of impairments and mitigation that are
            not modelled.
        """
        if scenario.scene is None or scenario.radar is None:
            raise InvalidSetting(
                "scenario",
                value="a recording, or traffic",
                expected="a scene to draw detections of",
                fix="give a scene and a radar",
            )
        radar = scenario.radar
        frame = radar.frame
        if frame.modulation is not None or frame.n_intervals > 1:
            raise InvalidSetting(
                "scenario.radar.frame."
                + ("interval" if frame.modulation is None else "modulation"),
                value="intervals in turn" if frame.modulation is None else frame.modulation.kind(),
                expected="equal ramps and frames, which the statistical sensor models",
                fix="simulate samples instead, or leave it out",
            )
        stages = sort_into_stages(scenario.impairments, radar)
        self._noise_w = added_noise_power_w(scenario, radar)
        if not 0 < self._noise_w < np.inf:
            raise InvalidSetting(
                "scenario.impairments",
                value="no white noise",
                expected="thermal noise or white noise, which detections are drawn from",
                fix="add an impairment of kind thermal-noise",
            )
        for finding in scene_findings(scenario.scene, radar, n_frames=scenario.n_frames):
            warnings.warn(PhysicsWarning(finding), stacklevel=2)
        self._scenario, self._radar, self._scene = scenario, radar, scenario.scene
        self._chain = scenario.chain.fit_to_radar(radar)
        self._paths = tuple(stage for stage in stages.paths if isinstance(stage, ATTENUATIONS))
        noises = [
            stage for stage in stages.impairments if stage.noise_power_w(self._scene, radar) > 0
        ]
        left_out = [
            stage.kind() for stage in stages.impairments if stage not in noises + list(self._paths)
        ]
        left_out += [m.kind() for m in self._chain.mitigation if not m.filters_slow_time]
        if left_out:
            warnings.warn(PhysicsWarning(_effects_not_modelled_finding(left_out)), stacklevel=2)
        numbers = range(scenario.n_frames)
        self._times_s = np.array([frame.frame_start_s(i) + frame.mid_frame_s for i in numbers])

    def draw_detections(self, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Draw one trial: columns of `processing.detect.detect`, (n_detections,) each."""
        blocks = [
            self._draw_detections_of_frame_block(first, rng)
            for first in range(0, len(self._times_s), _FRAMES_PER_BLOCK)
        ]
        return {name: np.concatenate([block[name] for block in blocks]) for name in UNITS}

    def draw_frame_detections(
        self, scene: Scene, rng: np.random.Generator
    ) -> dict[str, np.ndarray]:
        """Draw the first frame of another scene; columns as those of `draw_detections`.

        Radar, chain and impairments stay, with all that was prepared for them.
        """
        self._scene = scene
        self.__dict__.pop("_cached_echoes_of_all_frames", None)
        return self._draw_detections_of_frame_block(0, rng)

    def _draw_detections_of_frame_block(
        self, first_frame: int, rng: np.random.Generator
    ) -> dict[str, np.ndarray]:
        frames = slice(first_frame, min(first_frame + _FRAMES_PER_BLOCK, len(self._times_s)))
        received = self._echoes_of_frames(frames)
        n_frames = frames.stop - frames.start
        amplitude = self._apply_rcs_fluctuation(received.amplitude, rng)
        axes, windows, noise = (
            self._velocity_and_range_axis_statistics,
            self._training_window_statistics,
            self._map_noise_statistics,
        )
        loss = (
            noise.range_transform.noise_bandwidth_bins
            * noise.doppler_transform.noise_bandwidth_bins
        )
        energy = np.einsum("fsk,fsk->fs", amplitude, amplitude.conj()).real
        powers = energy * received.in_cells**2 / (loss * noise.n_channels)
        least = np.min(windows.factors)
        reached = 1 + powers + _MAX_SHORTFALL_STD * np.sqrt((1 + 2 * powers) / noise.n_channels)
        has_own_peak = (powers > _MIN_ECHO / np.sqrt(noise.n_channels)) & (reached > least)
        alarms = self._draw_noise_alarms(n_frames, rng)
        n_candidates = np.count_nonzero(has_own_peak)
        white = np.zeros(
            (
                n_candidates + len(alarms.window_draw),
                max_normal_numbers_per_candidate(axes, noise.n_channels),
            ),
            np.float32,
        )
        add_white_noise(white, 1.0, rng)
        echoes = FrameEchoes(
            received.velocity, received.row, amplitude, received.in_cells, powers, has_own_peak
        )
        window_draws = rng.integers(len(windows.statistic), size=n_candidates)
        peaks = sample_peaks(
            echoes, *axes, windows, alarms, self._searched_cell_mask, window_draws, white
        )
        columns = detections_from_sampled_peaks(peaks, self._radar, self._chain)
        columns["frame"] = columns["frame"] + first_frame
        columns["time"] = self._times_s[columns["frame"]]
        return columns

    def _apply_rcs_fluctuation(self, amplitude: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        scene, n_sent = self._scene, self._radar.frame.n_chirps_total
        if not scene.fluctuating_scatterers_by_model:
            return amplitude
        factors = np.ones(amplitude.shape[:2], np.float32)
        for number in range(len(factors)):
            per_frame, per_chirp = draw_fluctuation_factors(scene, n_sent, rng)
            factors[number] = np.sqrt(per_frame)
            if per_chirp is not None:
                factors[number] *= np.sqrt(per_chirp).mean(axis=0)
        return amplitude * factors[..., None]

    def _draw_noise_alarms(self, n_frames: int, rng: np.random.Generator) -> NoiseAlarms:
        """Draw the noise cells over threshold in each frame, a Poisson number."""
        counts = rng.poisson(self._mean_false_alarms_per_frame, n_frames)
        n = int(counts.sum())
        cells = (
            self._flat_indices_of_searched_cells[
                rng.integers(len(self._flat_indices_of_searched_cells), size=n)
            ]
            if n
            else np.empty(0, int)
        )
        positions = np.stack(np.divmod(cells, self._searched_cell_mask.shape[1]), axis=1).reshape(
            -1, 2
        )
        windows, n_channels = (
            self._training_window_statistics,
            self._map_noise_statistics.n_channels,
        )
        factors = windows.factors[positions[:, 1]]
        window_draw = np.searchsorted(self._cumulative_alarm_distribution_over_draws, rng.random(n))
        window_draw = np.minimum(window_draw, len(windows.statistic) - 1)
        tail_probability = scipy.special.gammaincc(
            n_channels, n_channels * factors * windows.statistic[window_draw]
        )
        power = (
            scipy.special.gammainccinv(n_channels, tail_probability * rng.random(n)) / n_channels
        )
        first = np.concatenate([[0], np.cumsum(counts)])
        return NoiseAlarms(first, positions, power, window_draw)

    def _echoes_of_frames(self, frames: slice) -> ReceivedEchoes:
        if self._cached_echoes_of_all_frames is not None:
            return ReceivedEchoes(*(column[frames] for column in self._cached_echoes_of_all_frames))
        return self._compute_echoes_at_times(self._times_s[frames])

    def _compute_echoes_at_times(self, times_s: np.ndarray) -> ReceivedEchoes:
        return compute_received_echoes(
            self._scene, self._radar, self._chain, self._paths, times_s, self._noise_w
        )

    @cached_property
    def _cached_echoes_of_all_frames(self) -> ReceivedEchoes | None:
        """Echoes of all frames, if they are few enough to cache."""
        n_values = len(self._times_s) * self._scene.n_scatterers * self._radar.n_summed_maps
        return (
            self._compute_echoes_at_times(self._times_s) if n_values <= _MAX_CACHED_VALUES else None
        )

    @cached_property
    def _map_noise_statistics(self) -> MapNoise:
        return self._chain.map_noise_statistics(self._radar)

    @cached_property
    def _velocity_and_range_axis_statistics(self) -> tuple[AxisStatistics, AxisStatistics]:
        return tabulate_lobe_and_noise_statistics(
            self._map_noise_statistics.doppler_transform
        ), tabulate_lobe_and_noise_statistics(self._map_noise_statistics.range_transform)

    @cached_property
    def _searched_cell_mask(self) -> np.ndarray:
        """Mask of the cells in which a peak may be, (n_velocity, n_rows)."""
        residual = residual_noise_gain(self._radar, self._chain)
        mask = np.zeros(
            (
                self._map_noise_statistics.doppler_transform.n_bins,
                self._training_window_statistics.factors.size,
            ),
            bool,
        )
        mask[:, np.isfinite(self._training_window_statistics.factors)] = True
        return mask if residual is None else mask & sufficient_noise_gain_mask(residual)

    @cached_property
    def _flat_indices_of_searched_cells(self) -> np.ndarray:
        return np.flatnonzero(self._searched_cell_mask)

    @cached_property
    def _training_window_statistics(self) -> TrainingWindows:
        chirp, cfar, noise = self._radar.frame.chirp, self._chain.cfar, self._map_noise_statistics
        rows = rows_with_circular_noise(chirp, noise.range_transform)
        n_bins = noise.range_transform.n_bins
        n_rows = n_bins if chirp.sampling == "complex" else n_bins // 2 + 1
        n_within = rows.stop - rows.start
        level = np.ones((noise.doppler_transform.n_bins, n_within), np.float32)
        cells = np.stack([np.zeros(n_within, int), np.arange(n_within)], axis=1)
        factors = np.full(n_rows, np.inf)
        factors[rows] = cfar.threshold_at_cells(level, cells, noise)
        window, (over_velocity, over_range) = (
            cfar.training_window,
            self._velocity_and_range_axis_statistics,
        )
        n_training, shifts = np.ones(n_rows), np.zeros(n_rows)
        n_training[rows] = window.n_training_cells_per_row(n_within)
        shifts[rows] = window.half_range - window.tested_rows_in_training_box(n_within)
        law = draw_training_window_statistics(cfar, noise)
        return TrainingWindows(
            statistic=law.statistic,
            corners=law.corners,
            sensitivity=law.sensitivity,
            factors=factors,
            n_training=n_training,
            shifts=shifts,
            box=(
                over_velocity.tabulate_tone_power_in_window(window.half_velocity),
                over_range.tabulate_tone_power_in_window(window.half_range),
            ),
            guard=(
                over_velocity.tabulate_tone_power_in_window(window.n_guard.velocity),
                over_range.tabulate_tone_power_in_window(window.n_guard.range),
            ),
            sidelobes=(
                sidelobe_envelope(noise.doppler_transform),
                sidelobe_envelope(noise.range_transform),
            ),
        )

    @cached_property
    def _alarm_probability_per_window_draw(self) -> np.ndarray:
        """Probability that noise exceeds its threshold in each draw of the training window."""
        n_channels, windows = (
            self._map_noise_statistics.n_channels,
            self._training_window_statistics,
        )
        factor = np.median(windows.factors[np.isfinite(windows.factors)])
        return np.asarray(
            scipy.special.gammaincc(n_channels, n_channels * factor * windows.statistic)
        )

    @cached_property
    def _cumulative_alarm_distribution_over_draws(self) -> np.ndarray:
        """Cumulative distribution of alarms over the draws of the training window."""
        return np.asarray(
            np.cumsum(self._alarm_probability_per_window_draw)
            / np.sum(self._alarm_probability_per_window_draw)
        )

    @cached_property
    def _mean_false_alarms_per_frame(self) -> float:
        """Mean number of cells over threshold in a frame of noise."""
        stated = self._chain.cfar.false_alarm_probability
        return len(self._flat_indices_of_searched_cells) * (
            float(np.mean(self._alarm_probability_per_window_draw)) if stated is None else stated
        )


@check_argument_types
def draw_statistical_detections(
    scenario: Scenario, *, seed: int | np.random.Generator | None = None
) -> xr.Dataset:
    """Draw the detections of a scenario without samples: a table as of `processing.detect.detect`.

    `seed`: an int or a Generator; by default that of the scenario. See `StatisticalSensor` for the
    approximations, the errors and the warnings.

    Parameters
    ----------
    scenario : Scenario
        Radar, targets and settings of the trial.
    seed : int or Generator, optional
        From 0 to 2**64 - 1; by default that of the scenario.
    """
    rng = seed if isinstance(seed, np.random.Generator) else None
    if rng is None:
        number = scenario.seed if seed is None else seed
        check_integer("seed", number, at_least=0, at_most=2**64 - 1)
        rng = np.random.default_rng(number)
    columns = StatisticalSensor(scenario).draw_detections(rng)
    return detections_from_columns(columns)


def _effects_not_modelled_finding(kinds: list[str]) -> Finding:
    return Finding(
        level="warning",
        setting="impairments",
        value=f"{', '.join(kinds)}, not modelled by the statistical sensor",
        expected="white noise, and attenuation by rain, fog and gas",
        fix="simulate samples (sensor: signal) to include other effects",
    )
