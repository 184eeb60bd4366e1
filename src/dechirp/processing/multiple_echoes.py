"""Echoes at multiples of the range of a strong echo, which are no targets of their own.

Two effects place echoes at k times the range R and k times the radial velocity v of a strong one:

* Waves that travel k times between the target and the radar, whose front reflects as well. They
  come from the direction of the target.
* Harmonics of its beat tone from a receiver that saturates, with k times its phase in each channel,
  so that the sine of the direction is k times as large, modulo what the array confuses.

Other targets lie there by chance. With n other detections beyond 1.5 R, and a share p of range,
velocity and direction that counts as a multiple, n p of them are expected, and the number found has
a Poisson probability. Detections count as multiples only if that probability is below 2 % for all
strong echoes of all frames together. So an echo alone needs a matching direction and a sparse map,
and a series does not; in rooms full of static echoes nothing is recognised.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy

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


def leave_out_multiple_echoes(
    columns: Mapping[str, np.ndarray], radar: Radar
) -> tuple[dict[str, np.ndarray], tuple[MultipleEcho, ...]]:
    """Return the columns of detections without echoes at multiples of strong ones, and these.

    `columns` are those of `core.detection_columns`, of one or more frames.
    """
    is_kept = np.ones(len(columns["range"]), bool)
    multiples: list[MultipleEcho] = []
    numbers = np.unique(columns["frame"])
    for number in numbers:
        rows = np.flatnonzero(columns["frame"] == number)
        frame_columns = {name: column[rows] for name, column in columns.items()}
        multiples_by_row = _find_multiples(frame_columns, radar, _MAX_PROBABILITY / len(numbers))
        is_kept[rows[list(multiples_by_row)]] = False
        multiples += multiples_by_row.values()
    return {name: column[is_kept] for name, column in columns.items()}, tuple(multiples)


def _find_multiples(
    columns: Mapping[str, np.ndarray], radar: Radar, max_probability: float
) -> dict[int, MultipleEcho]:
    """Return the multiples in one frame, by their rows."""
    range_m, snr = columns["range"], columns["snr"]
    cell_m = radar.frame.chirp.range_resolution_m
    is_strong = (snr >= _MIN_SNR) & (range_m >= _MIN_RANGE_CELLS * cell_m)
    strong_rows = np.flatnonzero(is_strong)[np.argsort(-snr[is_strong], kind="stable")]
    multiples: dict[int, MultipleEcho] = {}
    for strong in strong_rows:
        if strong in multiples:
            continue
        beyond = np.flatnonzero(range_m > 1.5 * range_m[strong])
        order, chance = _match_multiples(columns, strong, beyond, radar)
        is_multiple = order > 0
        expected = float(chance.sum())
        probability = scipy.special.pdtrc(is_multiple.sum() - 1, expected)
        if is_multiple.any() and probability * len(strong_rows) < max_probability:
            multiples |= {
                int(row): MultipleEcho(float(range_m[row]), int(k), float(range_m[strong]))
                for row, k in zip(beyond[is_multiple], order[is_multiple], strict=True)
            }
    return multiples


def _match_multiples(
    columns: Mapping[str, np.ndarray], strong: int, others: np.ndarray, radar: Radar
) -> tuple[np.ndarray, np.ndarray]:
    """Return of which order other detections are, 0 for none, and the chance of each to be one."""
    frame, chirp = radar.frame, radar.frame.chirp
    range_m, snr = columns["range"], columns["snr"]
    tolerance_m = _TOLERANCE_CELLS * chirp.range_resolution_m
    n_orders = int(np.sum(_ORDERS * range_m[strong] <= chirp.max_range_m + tolerance_m))
    extent_m = max(chirp.max_range_m - 1.5 * range_m[strong], tolerance_m)
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
    """Return a note that lists the echoes left out, those of the first ten ranges."""
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
            setting="recording.fit_chain",
            value=f"{len(multiples)} detections left out, at {', '.join(listed)}: at multiples of"
            " the range, velocity and direction of a strong echo, as of waves that travel several"
            " times between target and radar, or of a receiver that saturates",
            expected="targets that are at such places only by chance",
            fix="--set recording.fit_chain=false keeps them; turn or move a strong reflector to see"
            " whether they follow it",
        ),
    )
