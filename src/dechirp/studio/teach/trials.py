"""Trials of a faint target with two detectors."""

from collections import Counter
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import xarray as xr

from dechirp.certificate import published, sensitivity
from dechirp.certificate.detection import run_report_rule_trials
from dechirp.certificate.reference_trials import (
    REFERENCE_TARGET,
    TrialCondition,
    complex_white_noise,
    reference_echo_zero_before_arrival,
    reference_radar,
    run_target_trials,
    trial_column,
    unit_power_echo,
)
from dechirp.core.conventions import CUBE_AXES
from dechirp.core.units import from_decibels, to_decibels
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import power_map, threshold_map
from dechirp.processing.spectrum import noise_gain
from dechirp.theory import confidence_intervals
from dechirp.theory.windows import Window

SEED = 4
N_FRAMES = 2
"""Frames of a trial block: the first is shown, both are counted. They take 25 to 30 ms; four took
one core so long that a slow one drew 12.6 of 15 pictures a second."""
SNR_DB = (-48.0, -15.0)
CONFIDENCE = 0.95


@dataclass(frozen=True)
class NoiseSettings:
    """SNR and the window of the cell-averaging detector."""

    snr_db: float
    """SNR of the echo in each sample."""
    window: Window
    play: str


@dataclass(frozen=True, eq=False)
class RangeCut:
    """Power and threshold along range through the target, relative to the mean noise power."""

    range_m: np.ndarray
    power: np.ndarray
    threshold: np.ndarray


@dataclass(frozen=True, eq=False)
class NoiseFrame:
    """Cuts of one frame, and the detections in several frames."""

    settings: NoiseSettings
    number: int
    chain: RangeCut
    report: RangeCut
    hits: np.ndarray
    """By cell averaging of powers, in each of N_FRAMES frames; the cuts are of the first."""
    report_hits: np.ndarray
    snr_in_cell_db: float
    """SNR of the echo in its cell of the map."""
    theory_db: np.ndarray
    """SNR values per sample at which theory is given."""
    theory: np.ndarray
    """Detection probability, (theory_db,)."""
    report_theory: np.ndarray


def _noise_generator(block_number: int) -> np.random.Generator:
    """Return the generator of the noise of a block, the same for both detectors."""
    return np.random.default_rng((SEED, block_number))


def simulate_cfar_and_report_rule_hits(
    snr_db: float, window: Window, block_number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the hits (N_FRAMES,) of cell averaging and of the report's rule in a block."""
    conditions = (TrialCondition(window=window, snr_db=(snr_db,)),)
    chain_trials = run_target_trials(
        _noise_generator(block_number),
        N_FRAMES,
        **REFERENCE_TARGET._asdict(),
        conditions=conditions,
    )
    report_trials = run_report_rule_trials(
        _noise_generator(block_number), N_FRAMES, snr_db=(snr_db,)
    )
    return trial_column(chain_trials, "hit")[:, 0] > 0, report_trials[:, 1] > 0


def cell_averaging_range_cut(snr_db: float, window: Window, block_number: int) -> RangeCut:
    """Return power and threshold of cell averaging along range at the velocity of the target."""
    chain = Chain(range_window=window, doppler_window=window, angle=None)
    clean = unit_power_echo(*REFERENCE_TARGET).values[0]
    samples = _add_block_noise(clean, snr_db, block_number)
    cube = xr.DataArray(samples, dims=CUBE_AXES[1:])
    power = power_map(cube, reference_radar(), chain)
    threshold = threshold_map(power, reference_radar(), chain)
    noise = chain.map_noise_statistics(reference_radar())
    mean = noise_gain(noise.range_transform, noise.doppler_transform, reference_radar().frame.chirp)
    row_power = power.sel(velocity=REFERENCE_TARGET.velocity_m_per_s, method="nearest")
    return RangeCut(
        range_m=row_power.range.values,
        power=row_power.values / mean,
        threshold=threshold.sel(velocity=row_power.velocity).values / mean,
    )


def report_rule_range_cut(snr_db: float, block_number: int) -> RangeCut:
    """Return squared amplitude and threshold of the report's rule for the same frame."""
    amplitude, threshold, _ = published.apply_report_rule(
        _add_block_noise(reference_echo_zero_before_arrival(), snr_db, block_number)
    )
    over_range, over_velocity = published.OVER_RANGE, published.OVER_VELOCITY
    mean = noise_gain(over_range, over_velocity, reference_radar().frame.chirp)
    range_m, velocity = published.report_range_and_velocity_axes()
    row = int(np.argmin(abs(velocity - REFERENCE_TARGET.velocity_m_per_s)))
    return RangeCut(
        range_m=range_m, power=amplitude[row] ** 2 / mean, threshold=threshold[row] ** 2 / mean
    )


def _add_block_noise(clean_echo: np.ndarray, snr_db: float, block_number: int) -> np.ndarray:
    """Add the noise of the first frame of a block to an echo of power 1."""
    amplitude = np.float32(np.sqrt(from_decibels(snr_db)))
    return np.asarray(
        amplitude * clean_echo
        + complex_white_noise(_noise_generator(block_number), clean_echo.shape)
    )


@cache
def theoretical_detection_curves(window: Window) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return SNR in dB and the detection probabilities of cell averaging and the report's rule."""
    snr_db = np.linspace(*SNR_DB, 133)
    probability = sensitivity.theoretical_curve(window)(snr_db)
    return snr_db, probability, sensitivity.report_rule_curve()(snr_db)


def compute_cuts_and_hits(settings: NoiseSettings, block_number: int) -> NoiseFrame:
    """Compute the cuts of one frame, the detections of several, and the theory."""
    hits, report_hits = simulate_cfar_and_report_rule_hits(
        settings.snr_db, settings.window, block_number
    )
    theory_db, theory, report_theory = theoretical_detection_curves(settings.window)
    return NoiseFrame(
        settings=settings,
        number=block_number,
        chain=cell_averaging_range_cut(settings.snr_db, settings.window, block_number),
        report=report_rule_range_cut(settings.snr_db, block_number),
        hits=hits,
        report_hits=report_hits,
        snr_in_cell_db=snr_in_cell_db(settings),
        theory_db=theory_db,
        theory=theory,
        report_theory=report_theory,
    )


def snr_in_cell_db(settings: NoiseSettings) -> float:
    """Return the SNR of the echo in its cell of the map."""
    noise = Chain(
        range_window=settings.window, doppler_window=settings.window
    ).map_noise_statistics(reference_radar())
    gain = sensitivity.snr_gain_in_map(noise.range_transform, noise.doppler_transform)
    return settings.snr_db + float(to_decibels(gain))


@lru_cache(maxsize=1024)
def _hit_rate_confidence_interval(n_hits: int, n_frames: int) -> tuple[float, float]:
    """Return the interval of a proportion, cached: those of all levels take 20 ms."""
    return confidence_intervals.binomial_interval(n_hits, n_frames, confidence=CONFIDENCE)


class HitCounter:
    """Counter of frames and detections by SNR; a repeated block counts once."""

    def __init__(self) -> None:
        self._number = -1
        self._counted: set[tuple[str, float]] = set()
        """Conditions already counted in the current block."""
        self._counts: Counter[tuple[str, float, str]] = Counter()

    def add_hits_of_frame(self, frame: NoiseFrame) -> None:
        """Count the frames of a block."""
        window, snr_db = frame.settings.window, frame.settings.snr_db
        if frame.number != self._number:
            self._number, self._counted = frame.number, set()
        if (window, snr_db) in self._counted:
            return
        self._counted.add((window, snr_db))
        self._counts[window, snr_db, "frames"] += N_FRAMES
        self._counts[window, snr_db, "chain"] += int(frame.hits.sum())
        self._counts[window, snr_db, "report"] += int(frame.report_hits.sum())

    def hit_rates_with_intervals(self, window: Window, detector: str) -> np.ndarray:
        """Return SNR in dB, detection rate, both ends of its interval, and frames; (n, 5)."""
        rows = []
        for (counted_window, snr_db, count), n in sorted(self._counts.items()):
            if (counted_window, count) == (window, "frames"):
                k = self._counts[window, snr_db, detector]
                rows.append((snr_db, k / n, *_hit_rate_confidence_interval(k, n), n))
        return np.reshape(rows, (-1, 5))
