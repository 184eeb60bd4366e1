"""What was found, in words and numbers: the headline, the cards below it, the tables."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.values import value
from dechirp.core.words import NONE, decimals_of, fixed, ratio_db, small
from dechirp.report.view import View
from dechirp.scene.rcs import target_cross_sections_m2

_SIGMA = "\N{GREEK SMALL LETTER SIGMA}"


@value
class Card:
    """One number of the strongest detection."""

    name: str
    number: str
    std: str = ""
    unit: str
    small_print: str


def headline(view: View) -> str:
    """Say what was found, in one line."""
    n = view.strongest.sizes["detection"]
    if n == 0:
        return "Nothing detected"
    first = view.strongest.isel(detection=0)
    place = (
        f"{fixed(float(first.range), min(decimals_of(float(first.range_std)), 2))} m,"
        f" {fixed(float(first.velocity), min(decimals_of(float(first.velocity_std)), 2))} m/s"
    )
    if n == 1:
        return f"Target at {place}"
    within = "" if view.result.n_frames == 1 else f" in {view.result.n_frames} frames"
    return f"{n} detections{within}, the strongest at {place}"


def lead(view: View) -> str:
    """Say where the samples are from, and how many they are."""
    sizes, recording = view.first.sizes, view.result.scenario.recording
    source = "Simulated" if recording is None else f"Recorded in {Path(recording.path).name}"
    return (
        f"{source}: {_several(view.result.n_frames, 'frame')} of"
        f" {_several(sizes['chirp'], 'chirp')}, {sizes['sample']} samples each,"
        f" {_several(sizes['rx'], 'receiver')}."
    )


def cards(view: View) -> list[Card]:
    """List the numbers of the strongest detection; none without one."""
    if view.strongest.sizes["detection"] == 0:
        return []
    snr = fixed(ratio_db(float(view.strongest.snr[0])), 1)
    return [
        _estimate(view, "range", "m"),
        _estimate(view, "velocity", "m/s"),
        *(_estimate(view, name, "°") for name in angles(view)),
        Card(name="signal to noise", number=snr, unit="dB", small_print="after integration"),
        *_over_threshold(view),
    ]


def detections(view: View, n_rows: int) -> list[dict[str, str]]:
    """Write the lines of the detection table, strongest first, at most so many."""
    truth, matched = view.result.truth, view.matched
    rows = []
    for index in range(min(view.strongest.sizes["detection"], n_rows)):
        one = view.strongest.isel(detection=index)
        row = {
            "frame": str(int(one.frame)),
            "time": fixed(float(one.time) * 1e3, 3),
            "range": _with_std(one.range, one.range_std),
            "velocity": _with_std(one.velocity, one.velocity_std),
            "azimuth": _degrees(one.azimuth, one.azimuth_std),
            "elevation": _degrees(one.elevation, one.elevation_std),
            "snr": fixed(ratio_db(float(one.snr)), 1),
        }
        if truth is not None and matched is not None:
            target = int(matched.target[index])
            row["target"] = str(truth.target.values[target]) if target >= 0 else NONE
            row["range_error"] = _error(matched.range_error_m[index], one.range_std)
            row["velocity_error"] = _error(matched.velocity_error_m_per_s[index], one.velocity_std)
            for name, error_rad in (
                ("azimuth", matched.azimuth_error_rad[index]),
                ("elevation", matched.elevation_error_rad[index]),
            ):
                std = one[f"{name}_std"] * math.degrees(1)
                row[f"{name}_error"] = _error(math.degrees(error_rad), std)
        rows.append(row)
    return rows


def angles(view: View) -> list[str]:
    """Name the angles that any detection has."""
    return [
        name for name in ("azimuth", "elevation") if np.isfinite(view.strongest[name].values).any()
    ]


def errors(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Name what any of these detections has an error of; those of bodies have none."""
    names = ("range", "velocity", "azimuth", "elevation")
    return [name for name in names if any(row.get(f"{name}_error", NONE) != NONE for row in rows)]


def targets(view: View) -> list[dict[str, str]]:
    """List the truth in the first frame, and whether it was detected there."""
    truth, matched, scene = view.result.truth, view.matched, view.result.scenario.scene
    if truth is None or matched is None or scene is None:
        return []
    hits = _hits(view, view.result.first_frame)
    wavelength_m = view.result.radar.frame.chirp.wavelength_m
    rcs_m2 = target_cross_sections_m2(scene, truth.time.values[:1], wavelength_m)[0]
    rows = []
    for index, name in enumerate(scene.names):
        one = truth.isel(target=index, frame=0)
        rows.append(
            {
                "name": name,
                "rcs": fixed(ratio_db(float(rcs_m2[index])), 1),
                "range": fixed(float(one.range), 2),
                "velocity": fixed(float(one.velocity), 2),
                "azimuth": fixed(math.degrees(float(one.azimuth)), 1),
                "snr": fixed(ratio_db(float(one.snr)), 1) if one.snr > 0 else NONE,
                "detected": "yes" if index in hits else "no",
            }
        )
    return rows


def targets_found(view: View) -> str:
    """Say how many of the targets were detected, in the first frame and in all."""
    truth = view.result.truth
    if truth is None or view.matched is None:
        return ""
    n, numbers = truth.sizes["target"], truth.frame.values.tolist()
    found = f"{len(_hits(view, view.result.first_frame))} of {_several(n, 'target')}"
    if len(numbers) == 1:
        return f"Detected: {found}."
    n_all = sum(len(_hits(view, number)) for number in numbers)
    each = f"{n_all} of {n * len(numbers)}"
    return f"Detected: {found}; in all frames {each}, each counted in each frame."


def _hits(view: View, frame: int) -> set[int]:
    """Targets that were detected in a frame."""
    assert view.matched is not None
    return set(view.matched.target[view.strongest.frame.values == frame].tolist()) - {-1}


def _estimate(view: View, name: str, unit: str) -> Card:
    first, error = view.strongest.isel(detection=0), math.nan
    scale = math.degrees(1) if unit == "°" else 1.0
    if view.matched is not None:
        of = {
            "range": view.matched.range_error_m,
            "velocity": view.matched.velocity_error_m_per_s,
            "azimuth": view.matched.azimuth_error_rad,
            "elevation": view.matched.elevation_error_rad,
        }
        error = float(of[name][0]) * scale
    std = first[f"{name}_std"] * scale
    number, _, spread = _with_std(first[name] * scale, std).partition(" ")
    unit_after = f"\N{NO-BREAK SPACE}{unit}"
    unit_after = f"\N{NO-BREAK SPACE}{unit}"
    small_print = f"error {_error(error, std, unit_after)}" if math.isfinite(error) else ""
    return Card(name=name, number=number, std=spread, unit=unit, small_print=small_print)


def _over_threshold(view: View) -> list[Card]:
    """How far the strongest peak stands out; the map shows the first frame only."""
    power, threshold = view.at_cell(view.result.power), view.at_cell(view.result.threshold)
    in_map = int(view.strongest.frame[0]) == view.result.first_frame
    if not (in_map and power > 0 and 0 < threshold < math.inf):
        return []
    probability = view.result.scenario.chain.cfar.false_alarm_probability
    words = "" if probability is None else f"set for {small(probability)} false alarms a cell"
    over = fixed(ratio_db(power / threshold), 1)
    return [Card(name="over the threshold", number=over, unit="dB", small_print=words)]


def _with_std(estimate: xr.DataArray, std: xr.DataArray) -> str:
    decimals = decimals_of(float(std))
    return f"{fixed(float(estimate), decimals)} ±\N{NO-BREAK SPACE}{fixed(float(std), decimals)}"


def _degrees(estimate: xr.DataArray, std: xr.DataArray) -> str:
    if not np.isfinite(float(estimate)):
        return NONE
    return _with_std(estimate * math.degrees(1), std * math.degrees(1))


def _error(error: float, std: xr.DataArray, unit: str = "") -> str:
    """Write an error, and how many standard errors that is."""
    if not math.isfinite(error):
        return NONE
    text = fixed(error, decimals_of(float(std)), sign=True) + unit
    if not float(std) > 0:
        return text
    return f"{text} ({fixed(abs(error) / float(std), 1)}\N{NO-BREAK SPACE}{_SIGMA})"


def _several(n: int, thing: str) -> str:
    return f"{n} {thing}" if n == 1 else f"{n} {thing}s"
