"""What lesson 4 shows: frames of a faint target, and how often two detectors find it."""

from collections import Counter
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.units import decibels, from_decibels
from dechirp.experiment.verify import published, sensitivity
from dechirp.experiment.verify.detection import report_in_noise
from dechirp.experiment.verify.looks import (
    REFERENCE,
    Look,
    column,
    echo,
    late_echo,
    look_at_target,
    radar,
    white_noise,
)
from dechirp.process.chain import Chain
from dechirp.process.maps import power_map, threshold_map
from dechirp.process.spectrum import noise_gain
from dechirp.theory import intervals
from dechirp.theory.windows import Window

SEED = 4
N_EACH = 4
"""Frames of a look: the first is shown, all are counted. They take 50 ms."""
SNR_DB = (-48.0, -15.0)
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Settings:
    """How much noise there is, and the window of the right detector."""

    snr_db: float
    """Of the echo in each sample."""
    window: Window
    play: str


@dataclass(frozen=True, eq=False)
class Cut:
    """Power along range through the target, and the threshold, over the mean noise power."""

    range_m: np.ndarray
    power: np.ndarray
    threshold: np.ndarray


@dataclass(frozen=True, eq=False)
class Seen:
    """One frame, and whether the target was found in it and in some more."""

    at: Settings
    number: int
    chain: Cut
    report: Cut
    found: np.ndarray
    """By cell averaging of powers, in each of N_EACH frames; the cuts are of the first."""
    found_by_report: np.ndarray
    in_cell_db: float
    """Ratio of the echo to the noise in its cell of the map."""
    theory_db: np.ndarray
    """Ratios in each sample at which there is theory."""
    theory: np.ndarray
    """Probability of detection, (theory_db,)."""
    theory_of_report: np.ndarray


def _generator(number: int) -> np.random.Generator:
    """Of the noise of a look: both detectors see the same."""
    return np.random.default_rng((SEED, number))


def hits(snr_db: float, window: Window, number: int) -> tuple[np.ndarray, np.ndarray]:
    """In which frames the target is found, (N_EACH,) each: cell averaging, the report's rule."""
    looks = (Look(window=window, snr_db=(snr_db,)),)
    ours = look_at_target(_generator(number), N_EACH, **REFERENCE._asdict(), looks=looks)
    theirs = report_in_noise(_generator(number), N_EACH, snr_db=(snr_db,))
    return column(ours, "hit")[:, 0] > 0, theirs[:, 1] > 0


def chain_cut(snr_db: float, window: Window, number: int) -> Cut:
    """What cell averaging sees of a frame along range, at the velocity of the target."""
    chain = Chain(range_window=window, doppler_window=window, angle=None)
    clean = echo(*REFERENCE).values[0]
    samples = _noisy(clean, snr_db, number)
    cube = xr.DataArray(samples, dims=CUBE_AXES[1:])
    power = power_map(cube, radar(), chain)
    threshold = threshold_map(power, radar(), chain)
    noise = chain.noise(radar())
    mean = noise_gain(noise.over_range, noise.over_velocity, radar().frame.chirp)
    at = power.sel(velocity=REFERENCE.velocity_m_per_s, method="nearest")
    return Cut(
        range_m=at.range.values,
        power=at.values / mean,
        threshold=threshold.sel(velocity=at.velocity).values / mean,
    )


def report_cut(snr_db: float, number: int) -> Cut:
    """What the report's rule sees of the same frame, its amplitudes squared."""
    amplitude, threshold, _ = published.rule(_noisy(late_echo(), snr_db, number))
    over_range, over_velocity = published.OVER_RANGE, published.OVER_VELOCITY
    mean = noise_gain(over_range, over_velocity, radar().frame.chirp)
    range_m, velocity = published.axes_m_and_m_per_s()
    row = int(np.argmin(abs(velocity - REFERENCE.velocity_m_per_s)))
    return Cut(
        range_m=range_m, power=amplitude[row] ** 2 / mean, threshold=threshold[row] ** 2 / mean
    )


def _noisy(clean: np.ndarray, snr_db: float, number: int) -> np.ndarray:
    """Samples (chirp, rx, sample) of an echo of power 1 in the noise of a look's first frame."""
    amplitude = np.float32(np.sqrt(from_decibels(snr_db)))
    return np.asarray(amplitude * clean + white_noise(_generator(number), clean.shape))


@cache
def theory(window: Window) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ratios in dB, and the probability of detection by cell averaging and by the report's rule."""
    snr_db = np.linspace(*SNR_DB, 133)
    ours = sensitivity.curve_of_theory(window)(snr_db)
    return snr_db, ours, sensitivity.report_curve()(snr_db)


def seen(at: Settings, number: int) -> Seen:
    """One frame, with what theory expects of many."""
    found, found_by_report = hits(at.snr_db, at.window, number)
    theory_db, ours, theirs = theory(at.window)
    return Seen(
        at=at,
        number=number,
        chain=chain_cut(at.snr_db, at.window, number),
        report=report_cut(at.snr_db, number),
        found=found,
        found_by_report=found_by_report,
        in_cell_db=in_cell_db(at),
        theory_db=theory_db,
        theory=ours,
        theory_of_report=theirs,
    )


def in_cell_db(at: Settings) -> float:
    """Ratio of the echo to the noise in its cell of the map."""
    noise = Chain(range_window=at.window, doppler_window=at.window).noise(radar())
    gain = sensitivity.in_map(noise.over_range, noise.over_velocity)
    return at.snr_db + float(decibels(gain))


@lru_cache(maxsize=1024)
def _interval(hits: int, frames: int) -> tuple[float, float]:
    """Of a share; those of all levels take 20 ms, and all but one are as before."""
    return intervals.binomial(hits, frames, confidence=CONFIDENCE)


class Tally:
    """Frames and hits at each ratio; a look that is shown again counts once."""

    def __init__(self) -> None:
        self._number = -1
        self._known: set[tuple[str, float]] = set()
        """What was counted of the look of that number."""
        self._counts: Counter[tuple[str, float, str]] = Counter()

    def add(self, seen: Seen) -> None:
        """Count the frames of a look."""
        window, snr_db = seen.at.window, seen.at.snr_db
        if seen.number != self._number:
            self._number, self._known = seen.number, set()
        if (window, snr_db) in self._known:
            return
        self._known.add((window, snr_db))
        self._counts[window, snr_db, "frames"] += N_EACH
        self._counts[window, snr_db, "chain"] += int(seen.found.sum())
        self._counts[window, snr_db, "report"] += int(seen.found_by_report.sum())

    def shares(self, window: Window, who: str) -> np.ndarray:
        """Ratio in dB, share of hits, both ends of its interval, and frames; (n, 5)."""
        rows = []
        for (of, snr_db, what), n in sorted(self._counts.items()):
            if (of, what) == (window, "frames"):
                k = self._counts[window, snr_db, who]
                rows.append((snr_db, k / n, *_interval(k, n), n))
        return np.reshape(rows, (-1, 5))
