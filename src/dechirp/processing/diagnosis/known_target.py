"""Mistakes shown by a known target: a peak at a mirrored, shifted or scaled place."""

from dataclasses import dataclass

import numpy as np

from dechirp.core.units import to_decibels
from dechirp.processing.diagnosis.diagnosis import (
    NOTHING_FOUND,
    Diagnosis,
    cannot_be_told,
    mistake_found,
)
from dechirp.processing.diagnosis.map_peaks import MapPeaks

_TOLERANCE_CELLS = 1.5
_ORIGIN_TOLERANCE_CELLS = 0.25
_MAX_CHANCE = 0.1
_TOLERANCE = 0.02  # of the range, for a tape measure and a delay in the cables


@dataclass(frozen=True)
class UnambiguousSpan:
    """Ranges that the samples of a radar distinguish."""

    max_range_m: float
    is_complex: bool
    """False for real samples, whose spectrum is mirrored at `max_range_m`."""

    def alias(self, range_m: float, velocity_m_per_s: float) -> tuple[float, float]:
        """Return the place at which the samples show an echo."""
        if self.is_complex:
            return range_m % self.max_range_m, velocity_m_per_s
        cell_m = range_m % (2 * self.max_range_m)
        if cell_m <= self.max_range_m:
            return cell_m, velocity_m_per_s
        return 2 * self.max_range_m - cell_m, -velocity_m_per_s


def diagnose_known_target(
    peaks: MapPeaks,
    range_m: np.ndarray,
    velocity_m_per_s: np.ndarray | None,
    target_m: float,
    target_m_per_s: float | None,
    *,
    span: UnambiguousSpan | None,
    content: str,
    has_static_row: bool,
) -> Diagnosis:
    """Look for a known target where it should be, and where mistakes would put it.

    `span` contains the ranges of the radar, None without a radar: a phase f(t) t doubles ranges,
    of which those beyond the span are aliased. Without a radar, an axis from 0 is taken as the
    whole span, where swapped parts turn the cell k into n - k. In a map, ranges may have been
    reversed alone, which keeps the sign of the velocity.
    `has_static_row` where static echoes lie at velocity 0, so that no fftshift is missing.
    """
    velocities = np.zeros(1) if velocity_m_per_s is None else velocity_m_per_s
    knows_velocity = target_m_per_s is not None and velocity_m_per_s is not None
    v = target_m_per_s if knows_velocity and target_m_per_s is not None else 0.0
    half_span = velocities.size // 2 * _step(velocities)
    range_span = range_m.size // 2 * _step(range_m)
    alias = (lambda range_m, v: (range_m, v)) if span is None else span.alias
    # Setting, range and velocity of the echo, correction.
    places = [
        (None, *alias(target_m, v), ""),
        ("samples.phase", *alias(2 * target_m, v), _PHASE_FIX),
        ("range_m.scale", target_m / 2, v, _HALF_FIX),
    ]
    if knows_velocity:
        places += [
            ("velocity_m_per_s.sign", target_m, -v, _SIGN_FIX),
            ("velocity_m_per_s.scale", target_m, 2 * v, "the velocity is lambda f / 2"),
            ("velocity_m_per_s.scale", target_m, v / 2, "the factor 1/2 is applied twice"),
        ]
        if not has_static_row:
            places.append(("fftshift", target_m, _wrap(v + half_span, half_span), _SHIFT_FIX))
    shifted_m = target_m + range_span * (1 if target_m < range_m.min() + range_span else -1)
    places.append(("fftshift", shifted_m, v, "apply fftshift along velocity, not along range"))
    if knows_velocity and range_m.size == velocities.size:
        # Axes of equal length: an exchange swaps the cells of range and velocity.
        range_cell = (target_m - range_m[0]) / _step(range_m)
        velocity_cell = (v - velocities[0]) / _step(velocities)
        exchanged_m = range_m[0] + velocity_cell * _step(range_m)
        exchanged_v = velocities[0] + range_cell * _step(velocities)
        places.append(("axes", exchanged_m, exchanged_v, "transpose the map"))
    starts_at_zero = abs(range_m[0]) < _ORIGIN_TOLERANCE_CELLS * _step(range_m)
    if span is not None and span.is_complex:
        mirrored_m = span.max_range_m - target_m
        places.append(("iq", mirrored_m, -v, "exchange I and Q"))
        # Velocities of both signs must be two tolerances apart, also at the ends of the axis.
        is_moving = abs(_wrap(2 * v, half_span)) > 2 * _TOLERANCE_CELLS * _step(velocities)
        if content == "map" and knows_velocity and is_moving:
            fix = "reverse the powers along range, and keep the axis"
            places.append(("range_m.mirror", mirrored_m, v, fix))
    elif span is None and knows_velocity and starts_at_zero:
        whole_span_m = range_m.size * _step(range_m)
        places.append(("iq", whole_span_m - target_m, -v, "exchange I and Q"))
    levels = [
        _level_near(peaks, range_m, velocities, place_m, place_v, any_velocity=not knows_velocity)
        for _, place_m, place_v, _ in places
    ]
    if levels[0] > 0:
        return NOTHING_FOUND
    candidates = {
        setting: (level, index)
        for index, ((setting, *_), level) in reversed(
            list(enumerate(zip(places, levels, strict=True)))
        )
        if level > 0
    }
    text = f"no echo at the target ({target_m:g} m" + (f", {v:g} m/s)" if knows_velocity else ")")
    if len(candidates) != 1:
        names = ", ".join(map(str, candidates)) or "none of the known mistakes"
        return cannot_be_told(
            "target",
            value=f"{text}; echoes elsewhere fit {names}",
            expected=f"an echo within {_TOLERANCE_CELLS:g} cells and {_TOLERANCE:.0%}",
            fix="give a frame with one strong target, and its range and velocity at that time",
        )
    ((setting, (level, index)),) = candidates.items()
    # Echoes as strong as this one, within 6 dB, and the cells in which one would fit a mistake.
    n_strong = int(np.count_nonzero(4 * peaks.snr >= level))
    n_cells = 2 * _TOLERANCE_CELLS * len(places) * (2 * _TOLERANCE_CELLS if knows_velocity else 1)
    share = n_cells / (range_m.size * (velocities.size if knows_velocity else 1))
    chance = 1 - (1 - min(share, 1.0)) ** n_strong
    if chance > _MAX_CHANCE:
        return cannot_be_told(
            "target",
            value=f"{text}; one of {n_strong} echoes fits {setting}, with a probability of chance"
            f" of {chance:.2g}",
            expected=f"a probability of at most {_MAX_CHANCE:g}",
            fix="give a frame in which the target is the strongest echo",
        )
    _, place_m, place_v, fix = places[index]
    place_text = f"{place_m:.4g} m" + (f", {place_v:.4g} m/s" if knows_velocity else "")
    return mistake_found(
        str(setting),
        value=f"{text}, but one of {to_decibels(level):.0f} dB over the noise at {place_text}"
        f" (probability of chance {chance:.1g})",
        expected=f"an echo within {_TOLERANCE_CELLS:g} cells and {_TOLERANCE:.0%} of the target",
        fix=fix,
    )


_PHASE_FIX = (
    "integrate the frequency: the phase of f0 + S t is 2 pi (f0 t + S t^2 / 2), not 2 pi f(t) t;"
    " in a recording, check the slope S"
)
_HALF_FIX = (
    "ranges are half of the true ones: the axis ends at fs / 2 in place of fs, or the slope S is"
    " twice the true one"
)
_SIGN_FIX = "positive velocities recede here: negate the velocity axis, or conjugate slow time"
_SHIFT_FIX = "apply fftshift along the velocity axis, and only there"


def _step(axis: np.ndarray) -> float:
    return float(abs(axis[-1] - axis[0])) / max(axis.size - 1, 1)


def _wrap(velocity: float, half_span: float) -> float:
    """Alias a velocity into +- half_span."""
    if half_span == 0:
        return velocity
    return (velocity + half_span) % (2 * half_span) - half_span


def _level_near(
    peaks: MapPeaks,
    range_m: np.ndarray,
    velocities: np.ndarray,
    place_m: float,
    place_v: float,
    *,
    any_velocity: bool,
) -> float:
    """Return the level of the strongest echo near a place; 0 without one."""
    range_tolerance = _TOLERANCE_CELLS * _step(range_m) + _TOLERANCE * abs(place_m)
    is_near = abs(range_m[peaks.column] - place_m) < range_tolerance
    if not any_velocity:
        difference = velocities[peaks.row] - place_v
        period = velocities.size * _step(velocities)
        difference -= period * np.round(difference / period)
        is_near &= abs(difference) < _TOLERANCE_CELLS * _step(velocities)
    return float(peaks.snr[is_near].max(initial=0.0))
