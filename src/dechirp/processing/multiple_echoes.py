"""Echoes at multiples of the range of a strong echo, which may be no targets of their own.

Two effects place echoes at k times the range R and k times the radial velocity v of a strong one:

* Waves that travel k times between the target and the radar, whose front reflects as well. They
  come from the direction of the target.
* Harmonics of its beat tone from a receiver that saturates, with k times its phase in each channel,
  so that the sine of the direction is k times as large, modulo what the array confuses.

Targets may lie there too. With n other detections beyond 1.5 R at random places, and a share p of
range, velocity and direction that counts as a multiple, n p of them are expected, and the number
found has a Poisson probability. Detections are reported as multiples only if that probability is
below 2 % for all strong echoes of all frames together. So an echo alone needs a matching direction
and a sparse map, and a series does not; in rooms full of static echoes nothing is recognised.

Places are not random where equal posts stand at equal distances, or where one person walks twice as
fast as another at half the range. One frame cannot tell these from multiples, so all detections are
kept, and a finding names those that may be multiples.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import format_number
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.radar import Radar

# Multiples of the range that are tested: five in all.
_ORDERS = np.arange(2, 7)
_MAX_PROBABILITY = 0.02
# Power of the strong echo over the noise, and over its multiples: 30 dB and 6 dB.
_MIN_SNR, _MIN_POWER_RATIO = 1e3, 4.0
# Nearest range of the strong echo, in cells. Nearer ones have multiples in every few cells.
_MIN_RANGE_CELLS = 8
# Largest deviation of a multiple, in cells of range and of velocity, and in standard errors.
_TOLERANCE_CELLS, _TOLERANCE_STD = 1.0, 2.0


class MultipleEcho(NamedTuple):
    """Echo at a multiple of the range of a strong one."""

    range_m: float
    order: int
    strong_range_m: float


def find_multiple_echoes(
    columns: Mapping[str, np.ndarray], radar: Radar, max_range_m: float | None = None
) -> tuple[MultipleEcho, ...]:
    """Return the detections that may be multiples of strong echoes.

    `columns` are those of `core.detection_columns`, of one or more frames, whose detections reach
    to `max_range_m`: by default, to the end of the range axis.
    """
    chirp_range_m = radar.frame.chirp.max_range_m
    max_range_m = chirp_range_m if max_range_m is None else min(max_range_m, chirp_range_m)
    multiples: list[MultipleEcho] = []
    numbers = np.unique(columns["frame"])
    for number in numbers:
        in_frame = columns["frame"] == number
        frame_columns = {name: column[in_frame] for name, column in columns.items()}
        multiples += _find_frame_multiples(
            frame_columns, radar, max_range_m, _MAX_PROBABILITY / len(numbers)
        )
    return tuple(multiples)


def _find_frame_multiples(
    columns: Mapping[str, np.ndarray], radar: Radar, max_range_m: float, max_probability: float
) -> tuple[MultipleEcho, ...]:
    """Return the multiples in one frame, each of one strong echo."""
    range_m, snr = columns["range"], columns["snr"]
    cell_m = radar.frame.chirp.range_resolution_m
    is_strong = (snr >= _MIN_SNR) & (range_m >= _MIN_RANGE_CELLS * cell_m)
    strong_rows = np.flatnonzero(is_strong)[np.argsort(-snr[is_strong], kind="stable")]
    multiples: dict[int, MultipleEcho] = {}
    for strong in strong_rows:
        if strong in multiples:
            continue
        beyond = np.flatnonzero(range_m > 1.5 * range_m[strong])
        order, chance = _match_multiples(columns, strong, beyond, radar, max_range_m)
        is_multiple = order > 0
        expected = float(chance.sum())
        probability = scipy.special.pdtrc(is_multiple.sum() - 1, expected)
        if is_multiple.any() and probability * len(strong_rows) < max_probability:
            multiples |= {
                int(row): MultipleEcho(float(range_m[row]), int(k), float(range_m[strong]))
                for row, k in zip(beyond[is_multiple], order[is_multiple], strict=True)
            }
    return tuple(multiples.values())


def _match_multiples(
    columns: Mapping[str, np.ndarray],
    strong: int,
    others: np.ndarray,
    radar: Radar,
    max_range_m: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return of which order other detections are, 0 for none, and the chance of each to be one."""
    frame, chirp = radar.frame, radar.frame.chirp
    range_m, snr = columns["range"], columns["snr"]
    tolerance_m = _TOLERANCE_CELLS * chirp.range_resolution_m
    n_orders = int(np.sum(_ORDERS * range_m[strong] <= max_range_m + tolerance_m))
    extent_m = max(max_range_m - 1.5 * range_m[strong], tolerance_m)
    chance = np.full(len(others), min(1.0, n_orders * 2 * tolerance_m / extent_m))
    order = np.round(range_m[others] / range_m[strong]).astype(int)
    is_multiple = (order <= _ORDERS[-1]) & (
        abs(range_m[others] - order * range_m[strong]) <= tolerance_m
    )
    is_multiple &= snr[others] * _MIN_POWER_RATIO <= snr[strong]

    velocity = columns["velocity"]
    if np.isfinite(velocity[strong]):
        span = 2 * frame.max_velocity_m_per_s
        cell = frame.velocity_resolution_m_per_s
        deviation = velocity[others] - order * velocity[strong]
        deviation -= span * np.round(deviation / span)
        is_multiple &= ~(abs(deviation) > order * _TOLERANCE_CELLS * cell)
        if abs(velocity[strong]) > cell:  # static echoes share one velocity
            chance *= min(1.0, 2 * _TOLERANCE_CELLS * cell / span)

    for name in ("azimuth", "elevation"):
        sine = np.sin(columns[name])
        std = np.cos(columns[name]) * columns[f"{name}_std"]
        if not np.isfinite(sine[strong] + std[strong]):
            continue
        tolerance = _TOLERANCE_STD * np.hypot(std[others], order * std[strong])
        period = _ambiguous_sine_step(radar, name)
        harmonic = order * sine[strong] - sine[others]
        harmonic -= period * np.round(harmonic / period)
        deviation = np.minimum(abs(sine[others] - sine[strong]), abs(harmonic))
        # Detections without a direction may have any.
        is_multiple &= ~(deviation > tolerance)
        chance *= np.where(np.isfinite(deviation), np.minimum(1.0, 2 * tolerance), 1.0)
    return np.where(is_multiple, order, 0), chance


def _ambiguous_sine_step(radar: Radar, angle: str) -> float:
    """Return the difference of sines that the smallest spacing of the elements confuses."""
    coordinates = radar.element_positions_m[:, {"azimuth": 1, "elevation": 2}[angle]]
    steps = np.diff(np.unique(np.round(coordinates, 9)))
    wavelength_m = SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz
    return float(wavelength_m / steps.min()) if steps.size else np.inf


def multiple_echo_findings(multiples: Sequence[MultipleEcho]) -> tuple[Finding, ...]:
    """Return a note that lists the echoes, those of the first ten ranges."""
    if not multiples:
        return ()
    by_order: dict[tuple[float, int], MultipleEcho] = {}
    for echo in multiples:
        by_order.setdefault((round(echo.strong_range_m, 1), echo.order), echo)
    listed = [
        f"{format_number(echo.range_m, 4)} m ({echo.order} x"
        f" {format_number(echo.strong_range_m, 4)} m)"
        for echo in list(by_order.values())[:10]
    ]
    return (
        Finding(
            level="note",
            setting="recording",
            value="detections that may be no targets of their own:"
            f" {format_count_with_noun(len(multiples), 'detection')} at {', '.join(listed)}, at"
            " multiples of the range, velocity and direction of a strong echo, as of waves that"
            " travel several times between target and radar, or of harmonics of a receiver that"
            " saturates",
            expected="targets at such places only by chance, or by design, such as a row of posts",
            fix="move the strong reflector by 1 m: its k-th multiple moves by k m, a target stays;"
            " or lower the gain by 6 dB: a k-th harmonic falls by k x 6 dB",
        ),
    )
