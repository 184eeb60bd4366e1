"""Labels, units and formatted values of settings and scores."""

import math
import re

import numpy as np

from dechirp.core.text import EN_DASH, MINUS_SIGN, TIMES_SIGN, format_number, format_power_of_ten
from dechirp.core.values import frozen_dataclass

RANGE_LABEL = "Range (m)"
VELOCITY_LABEL = "Velocity (m/s, receding positive)"
AZIMUTH_LABEL = "Azimuth (°, left positive)"
ELEVATION_LABEL = "Elevation (°, up positive)"
X_LABEL = "x (m, forward)"
Y_LABEL = "y (m, left positive)"
TIME_LABEL = "Time (s)"
TIME_SINCE_RAMP_START_LABEL = "Time since ramp start (µs)"
BEAT_FREQUENCY_LABEL = "Beat frequency (MHz)"
POWER_OVER_NOISE_LABEL = "Power over mean noise (dB)"
POWER_RELATIVE_TO_PEAK_LABEL = "Power relative to the peak (dB)"
SNR_PER_SAMPLE_LABEL = "SNR per sample (dB)"
DETECTION_PROBABILITY_LABEL = "Detection probability"

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


def setting_label(path: str) -> str:
    """Return the label of a setting: `scene.targets.car.rcs` becomes "RCS of car"."""
    parts = path.split(".")
    if len(parts) > 1 and parts[-1] in _AXES and parts[-2] in _VECTORS:
        parts = [*parts[:-2], f"{parts[-2]} {_AXES[parts[-1]]}"]
    quantity = _identifier_as_words(parts[-1])
    owners = [part for part in parts[:-1] if part not in _CONTAINERS]
    # Names given by the user remain unchanged.
    is_user_name = "targets" in parts[:-1] and parts.index("targets") + 1 < len(parts) - 1
    owner = (
        owners[0] if is_user_name and owners else " ".join(map(_identifier_as_words, owners[-1:]))
    )
    return f"{quantity} of {owner}" if owner else quantity


def value_label(value_text: str) -> str:
    """Return the label of a value: `{kind: ordered-statistic}` becomes "ordered statistic"."""
    kind = _KIND.fullmatch(value_text.strip())
    if kind:
        return kind[1].replace("-", " ")
    return re.sub(r"(?<![\w.])-(?=\d)", MINUS_SIGN, value_text)


def score_label(score_name: str) -> str:
    """Return the label of a score: `range_rmse` becomes "range RMSE"."""
    return "area under ROC" if score_name == "roc" else _identifier_as_words(score_name)


def label_with_unit(label: str, unit: str) -> str:
    """Return an axis label with the unit: "RCS of car (dBsm)"."""
    return f"{label} ({unit})" if unit else label


def axis_label(label: str, unit: str) -> str:
    """Return a label with its unit, capitalised: "Range RMSE (m)"."""
    return label_with_unit(label[:1].upper() + label[1:], unit)


def power_label(unit: str) -> str:
    """Return the axis label of powers in a unit: "Power (dBm)"."""
    return axis_label("Power", unit)


@frozen_dataclass
class DisplayScale:
    """Factor and unit in which values of a score are displayed."""

    factor: float
    unit: str
    """Unit; empty for ratios."""


def choose_display_scale(unit: str | None, values: np.ndarray) -> DisplayScale:
    """Choose the display unit of a score: degrees for rad, and metric prefixes."""
    if unit == "rad":
        return DisplayScale(factor=math.degrees(1), unit="°")
    name = _UNITS.get(unit, (unit or "").replace("_per_", "/"))
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(sizes.max()) if sizes.size else 0.0
    fitting = [pair for pair in _PREFIXES.get(name, ()) if 0 < pair[0] <= largest]
    size, name = fitting[-1] if fitting else (1.0, name)
    return DisplayScale(factor=1 / size, unit=name)


def format_with_interval(measured: float, low: float, high: float) -> tuple[str, str]:
    """Format a value and its interval with two digits of its half width; NaN is a dash.

    Values below 10⁻³ have a power of ten, common to all three numbers.
    """
    if not math.isfinite(measured):
        return EN_DASH, EN_DASH
    finite_ends = [end for end in (low, high) if math.isfinite(end)]
    largest = max(abs(value) for value in (measured, *finite_ends))
    power = math.floor(math.log10(largest)) if 0 < largest < 1e-3 else 0
    scaled = [value / 10.0**power for value in (measured, low, high)]
    half = (scaled[2] - scaled[1]) / 2
    if math.isfinite(half) and half > 0:
        decimals = min(max(1 - math.floor(math.log10(half)), 0), 9)
        texts = [_format_fixed(value, decimals) for value in scaled]
    else:
        texts = [format_number(value) for value in scaled]
    power_text = f" {TIMES_SIGN} {format_power_of_ten(power)}" if power else ""
    interval = f"{texts[1]} to {texts[2]}{power_text}" if len(finite_ends) == 2 else EN_DASH
    return texts[0] + power_text, interval


def _format_fixed(value: float, decimals: int) -> str:
    if not math.isfinite(value):
        return EN_DASH
    text = f"{value:.{decimals}f}"
    return (text.lstrip("-") if float(text) == 0 else text).replace("-", MINUS_SIGN)


def _identifier_as_words(name: str) -> str:
    parts = re.split(r"[_\s-]+", name)
    words = " ".join(_SHORT.get(part, part) for part in parts if part)
    return words.replace("false alarm ", "false-alarm ")
