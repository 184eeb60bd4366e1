"""Settings and scores as axes and tables call them: words, a unit, and numbers in it."""

import math
import re

import numpy as np

from dechirp.core.values import value
from dechirp.core.words import MINUS, NONE, TIMES, number, power_of_ten

_CONTAINERS = {"scene", "targets", "radar", "frame", "chain", "impairments", "scenario", "hardware"}
_SHORT = {
    name: name.upper()
    for name in ("rcs", "snr", "cfar", "tdm", "bpm", "ddma", "pll", "roc", "rmse", "adc", "fft")
}
_AXES = {"0": "x", "1": "y", "2": "z"}
_VECTORS = {"position", "velocity", "acceleration", "mounting"}
_KIND = re.compile(r"\{\s*kind:\s*([\w-]+)\s*\}")
_UNITS = {None: "", "m": "m", "m_per_s": "m/s", "rad": "°", "s": "s"}
_PREFIXES = {
    "m": ((1e-6, "µm"), (1e-3, "mm"), (1.0, "m")),
    "s": ((1e-6, "µs"), (1e-3, "ms"), (1.0, "s")),
}


def setting_words(path: str) -> str:
    """Say what a setting is: `scene.targets.car.rcs` is the RCS of car."""
    parts = path.split(".")
    if len(parts) > 1 and parts[-1] in _AXES and parts[-2] in _VECTORS:
        parts = [*parts[:-2], f"{parts[-2]} {_AXES[parts[-1]]}"]
    what = _words(parts[-1])
    of = [part for part in parts[:-1] if part not in _CONTAINERS]
    # A name that somebody gave stays as it is.
    given = "targets" in parts[:-1] and parts.index("targets") + 1 < len(parts) - 1
    owner = of[0] if given and of else " ".join(map(_words, of[-1:]))
    return f"{what} of {owner}" if owner else what


def value_words(text: str) -> str:
    """Write the value of a setting for people: `{kind: ordered-statistic}`, ordered statistic."""
    kind = _KIND.fullmatch(text.strip())
    if kind:
        return kind[1].replace("-", " ")
    return re.sub(r"(?<![\w.])-(?=\d)", MINUS, text)


def score_words(label: str) -> str:
    """Write the label of a score: `range_rmse`, range RMSE; `roc`, area under ROC."""
    return "area under ROC" if label == "roc" else _words(label)


def with_unit(words: str, unit: str) -> str:
    """Words of an axis with the unit: RCS of car, dBsm."""
    return f"{words}, {unit}" if unit else words


@value
class Scale:
    """What values of a score are multiplied by to be shown, and the unit that they have then."""

    factor: float
    unit: str
    """Empty for ratios."""


def scale_of(unit: str | None, values: np.ndarray) -> Scale:
    """Find the unit in which values of a score are told: degrees, millimetres for millimetres."""
    if unit == "rad":
        return Scale(factor=math.degrees(1), unit="°")
    name = _UNITS.get(unit, (unit or "").replace("_per_", "/"))
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(sizes.max()) if sizes.size else 0.0
    fitting = [pair for pair in _PREFIXES.get(name, ()) if 0 < pair[0] <= largest]
    size, name = fitting[-1] if fitting else (1.0, name)
    return Scale(factor=1 / size, unit=name)


def told(measured: float, low: float, high: float) -> tuple[str, str]:
    """Write a value and its interval, with two digits of half of it; dashes where there is none.

    What is below 10⁻³ is written with a power of ten, the same in all three.
    """
    if not math.isfinite(measured):
        return NONE, NONE
    ends = [end for end in (low, high) if math.isfinite(end)]
    largest = max(abs(one) for one in (measured, *ends))
    power = math.floor(math.log10(largest)) if 0 < largest < 1e-3 else 0
    scaled = [one / 10.0**power for one in (measured, low, high)]
    half = (scaled[2] - scaled[1]) / 2
    if math.isfinite(half) and half > 0:
        decimals = min(max(1 - math.floor(math.log10(half)), 0), 9)
        texts = [_fixed(one, decimals) for one in scaled]
    else:
        texts = [number(one) for one in scaled]
    tail = f" {TIMES} {power_of_ten(power)}" if power else ""
    interval = f"{texts[1]} to {texts[2]}{tail}" if len(ends) == 2 else NONE
    return texts[0] + tail, interval


def _fixed(one: float, decimals: int) -> str:
    if not math.isfinite(one):
        return NONE
    text = f"{one:.{decimals}f}"
    return (text.lstrip("-") if float(text) == 0 else text).replace("-", MINUS)


def _words(name: str) -> str:
    parts = re.split(r"[_\s-]+", name)
    return " ".join(_SHORT.get(part, part) for part in parts if part)
