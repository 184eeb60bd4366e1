"""Detections at the mirror of a strong echo, which may be its I/Q image.

An I/Q mixer of unequal branches turns samples z into z + b conj(z): each echo of complex samples
has an image at the negative beat and Doppler frequencies, |b|^2 as strong. On the range axis of
length L an echo at R with velocity v has it at L - R with -v. |b|^2 is about the same for all
echoes: within 6 dB, as noise and the delay between I and Q change it.

`chain_fitting` leaves images out where they are proven. Here they are only named: a static target
may lie at a mirror by chance. Levels differ by nature from echo to echo, so the level of the
strongest mirrored echo is taken for |b|^2, and only pairs of this level count. With p the share of
range and velocity within the tolerance, m p of m pairs of this level would lie at mirrors by chance
if places were random, and the number found has a Poisson probability. Detections are named only if
that is below 2 % for all frames together.

Places are not random where a target stands by design at the mirror of another, at L - R.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import format_number
from dechirp.core.units import from_decibels, to_decibels
from dechirp.processing.chain import Chain
from dechirp.radar.radar import Radar

_MAX_PROBABILITY = 0.02
# Highest level of an image, as of I and Q that differ by 1.7 dB or 11 degrees; uncorrected mixers
# have -25 to -40 dB. And the largest difference between the levels of two images.
_MAX_LEVEL, _LEVEL_SPREAD = 1e-2, from_decibels(6.0)
# Largest deviation from a mirror: half a cell, as echoes that overlap shift each peak, and three
# standard errors of the difference.
_TOLERANCE_CELLS, _TOLERANCE_STD = 0.5, 3.0
_MAX_STRONG_ECHOES = 200


class ImageEcho(NamedTuple):
    """Detection at the mirror of a stronger echo."""

    range_m: float
    velocity_m_per_s: float
    strong_range_m: float
    strong_velocity_m_per_s: float
    level: float
    """Power relative to that of the strong echo."""


class _Pairs(NamedTuple):
    """Detections and the echoes of which they may be images, (n,)."""

    weak: np.ndarray
    strong: np.ndarray
    level: np.ndarray
    chance: np.ndarray
    """Probability that a detection at a random place lies at the mirror of the echo."""
    is_mirrored: np.ndarray


def find_image_echoes(
    columns: Mapping[str, np.ndarray],
    maps: Mapping[int, np.ndarray],
    radar: Radar,
    chain: Chain,
) -> tuple[ImageEcho, ...]:
    """Return the detections that may be I/Q images of strong echoes.

    Parameters
    ----------
    columns
        Those of `core.detection_columns`, with velocities as measured.
    maps
        Maps (velocity, range) of some frames by their numbers: detections of these are tested.
    radar, chain
        Those of the maps.
    """
    if radar.frame.chirp.sampling != "complex" or chain.image_rejection is not None:
        return ()
    images: list[ImageEcho] = []
    for number, power in maps.items():
        in_frame = columns["frame"] == number
        frame_columns = {name: column[in_frame] for name, column in columns.items()}
        images += _find_frame_images(
            frame_columns, power, radar, chain, max_probability=_MAX_PROBABILITY / len(maps)
        )
    return tuple(images)


def _find_frame_images(
    columns: Mapping[str, np.ndarray],
    power: np.ndarray,
    radar: Radar,
    chain: Chain,
    *,
    max_probability: float,
) -> list[ImageEcho]:
    """Return the images in one frame, each of one echo."""
    range_m, velocity = columns["range"], np.nan_to_num(columns["velocity"])
    peak_power = _peak_power(power, range_m, velocity, radar, chain)
    pairs = _pair_with_stronger(columns, peak_power, radar)
    mirrored = np.flatnonzero(pairs.is_mirrored)
    if not mirrored.size:
        return []
    level = pairs.level[mirrored[np.argmax(peak_power[pairs.strong[mirrored]])]]
    is_similar = abs(np.log(pairs.level / level)) <= np.log(_LEVEL_SPREAD)
    expected = float(pairs.chance[is_similar].sum())
    is_image = pairs.is_mirrored & is_similar
    n_images = np.unique(pairs.weak[is_image]).size
    # The level was chosen among those of all mirrored pairs.
    if scipy.special.pdtrc(n_images - 1, expected) * mirrored.size > max_probability:
        return []
    images: dict[int, ImageEcho] = {}
    for index in np.flatnonzero(is_image)[np.argsort(-pairs.level[is_image], kind="stable")]:
        weak, strong = int(pairs.weak[index]), int(pairs.strong[index])
        images[weak] = ImageEcho(  # of several echoes, the strongest remains
            float(range_m[weak]),
            float(velocity[weak]),
            float(range_m[strong]),
            float(velocity[strong]),
            float(pairs.level[index]),
        )
    return [images[weak] for weak in sorted(images)]


def _peak_power(
    power: np.ndarray, range_m: np.ndarray, velocity: np.ndarray, radar: Radar, chain: Chain
) -> np.ndarray:
    """Return the highest power of the cells of each detection and of their neighbours."""
    frame, (n_velocity, n_range) = radar.frame, power.shape
    bin_m = frame.chirp.range_bins_m(n_range)[1]
    columns = np.round(range_m / bin_m).astype(int)
    rows = np.zeros(len(range_m), int)
    if n_velocity > 1:
        velocity_bins = frame.velocity_bins_m_per_s(n_velocity)
        step = velocity_bins[1] - velocity_bins[0]
        rows = np.round((velocity - velocity_bins[0]) / step).astype(int)
    near = np.arange(-1, 2)
    return np.asarray(
        power[
            (rows[:, None, None] + near[:, None]) % n_velocity,
            (columns[:, None, None] + near) % n_range,
        ].max(axis=(1, 2), initial=0.0)
    )


def _pair_with_stronger(
    columns: Mapping[str, np.ndarray], peak_power: np.ndarray, radar: Radar
) -> _Pairs:
    """Return the pairs of a detection and an echo that is stronger by 20 dB or more."""
    frame, chirp = radar.frame, radar.frame.chirp
    strongest = np.argsort(-peak_power, kind="stable")[:_MAX_STRONG_ECHOES]
    is_weaker = peak_power[:, None] <= _MAX_LEVEL * peak_power[strongest]
    weak, column = np.nonzero(is_weaker & (peak_power[:, None] > 0))
    strong = strongest[column]

    def deviation_and_tolerance(
        name: str, span: float, cell: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return how far each pair is from mirrors, modulo the span, and what counts as equal."""
        values, std = columns[name], np.nan_to_num(columns[f"{name}_std"])
        deviation = values[weak] + values[strong]
        deviation = deviation - span * np.round(deviation / span)
        tolerance = _TOLERANCE_CELLS * cell + _TOLERANCE_STD * np.hypot(std[weak], std[strong])
        return deviation, np.minimum(tolerance, span / 2)

    deviation, tolerance = deviation_and_tolerance(
        "range", chirp.max_range_m, chirp.range_resolution_m
    )
    is_mirrored = abs(deviation) <= tolerance
    # Detections of each half of the axis have images in the other one.
    half = columns["range"] > chirp.max_range_m / 2
    chance = np.where(half[weak] != half[strong], 4 * tolerance / chirp.max_range_m, 0.0)
    is_mirrored &= half[weak] != half[strong]
    if np.isfinite(columns["velocity"]).any():
        span, cell = 2 * frame.max_velocity_m_per_s, frame.velocity_resolution_m_per_s
        deviation, tolerance = deviation_and_tolerance("velocity", span, cell)
        is_mirrored &= abs(deviation) <= tolerance
        # All static echoes have one velocity, and moving ones a random one.
        is_static = abs(columns["velocity"]) <= cell
        chance *= np.where(
            is_static[weak] & is_static[strong],
            1.0,
            np.where(is_static[weak] | is_static[strong], 0.0, 2 * tolerance / span),
        )
    return _Pairs(
        weak, strong, peak_power[weak] / peak_power[strong], np.minimum(chance, 1.0), is_mirrored
    )


def image_echo_findings(images: Sequence[ImageEcho], radar: Radar) -> tuple[Finding, ...]:
    """Return a note that lists the images, those of the first ten ranges."""
    if not images:
        return ()
    has_velocity = radar.frame.n_chirps > 1
    by_place = {(round(echo.range_m, 1), round(echo.velocity_m_per_s)): echo for echo in images}

    def format_place(range_m: float, velocity_m_per_s: float) -> str:
        text = f"{format_number(range_m, 4)} m"
        if has_velocity and abs(velocity_m_per_s) > radar.frame.velocity_resolution_m_per_s:
            text += f" and {format_number(velocity_m_per_s, 3)} m/s"
        return text

    listed = [
        f"{format_place(echo.range_m, echo.velocity_m_per_s)} (of"
        f" {format_place(echo.strong_range_m, echo.strong_velocity_m_per_s)})"
        for echo in list(by_place.values())[:10]
    ]
    level_db = float(np.median(to_decibels(np.array([echo.level for echo in images]))))
    return (
        Finding(
            level="note",
            setting="recording.iq_image",
            value="detections that may be no targets but I/Q images:"
            f" {format_count_with_noun(len(images), 'detection')} at {', '.join(listed)}, at the"
            f" mirrored range and velocity of echoes {-level_db:.0f} dB stronger",
            expected="targets there only by chance: one that stands at the mirrored range is named"
            " too",
            fix=f"--set 'chain.image_rejection={max(round(-level_db) - 6, 1)} dB' leaves them out;"
            " or move the radar by 1 m towards the strong echo: its image moves away by 1 m, a"
            " target nears",
        ),
    )
