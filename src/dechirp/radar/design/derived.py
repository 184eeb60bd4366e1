"""Derived values of a design, each with its formula."""

import math

from dechirp.core.text import format_number, format_quantity, format_with_si_prefix
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.design.requirements import Requirements
from dechirp.radar.radar import Radar

WORD_BYTES = 2  # 12- to 16-bit converters use 16-bit words


@frozen_dataclass
class DerivedValue:
    """A value that follows from the requirements."""

    name: str
    value: float
    unit: str
    """SI unit; `1` for counts and ratios."""
    formula: str
    symbols: str = ""
    """Values or definitions of the symbols in the formula, where needed."""

    @property
    def value_with_unit(self) -> str:
        """The value with its unit, such as 150 MHz."""
        if self.unit == "1":
            return format_number(self.value, 6)
        if self.unit == "Hz/s":
            return format_quantity(self.value, "hz_per_s", 6)
        if self.unit == "m/s":
            return format_quantity(self.value, "m_per_s", 6)
        if self.unit == "rad":
            return f"{math.degrees(self.value):.3g}°"
        return format_with_si_prefix(self.value, self.unit, 6)


def frame_cube_bytes(radar: Radar) -> int:
    """Return the size of one frame of all receivers, in 16-bit words."""
    chirp = radar.frame.chirp
    words = 2 if chirp.sampling == "complex" else 1
    return chirp.n_samples * radar.frame.n_chirps_total * radar.array.n_rx * words * WORD_BYTES


def data_rate_bits_per_s(radar: Radar) -> float:
    """Return the mean data rate of all receivers over a frame, in 16-bit words."""
    return 8 * frame_cube_bytes(radar) / radar.frame.duration_s


def mean_eirp_w(radar: Radar) -> float:
    """Return the EIRP averaged over a chirp interval."""
    frame = radar.frame
    return radar.require_hardware().eirp_w * frame.chirp.ramp_duration_s / frame.single_interval_s


def derive_radar_values(
    radar: Radar, requirements: Requirements, *, speed_of_light_m_per_s: float
) -> tuple[DerivedValue, ...]:
    """Return all values that follow from a radar, under either design rule."""
    frame, chirp = radar.frame, radar.frame.chirp
    # Lengths and velocities of `Radar` use the exact speed of light.
    scale = speed_of_light_m_per_s / SPEED_OF_LIGHT
    alias_formula = "c fs / 2 S" if chirp.sampling == "complex" else "c fs / 4 S"
    size_formula = "N M n_rx x 4 bytes" if chirp.sampling == "complex" else "N M n_rx x 2 bytes"
    farthest = f"R = {requirements.max_range_m:.6g} m"
    fastest = f"v = {requirements.max_velocity_m_per_s:.6g} m/s"
    sampled, middle = "B swept while sampling", "lambda at mid-window"
    rows: list[tuple[str, float, str, str, str]] = [
        ("start_frequency", chirp.start_frequency_hz, "Hz", "f0", "the carrier, if in the band"),
        ("ramp_bandwidth", chirp.ramp_bandwidth_hz, "Hz", "S T_ramp", "the whole ramp"),
        ("wavelength", chirp.wavelength_m * scale, "m", "c / f_mid", "f at mid-window"),
        (
            "max_beat_frequency",
            chirp.beat_frequency_hz(requirements.max_range_m) / scale,
            "Hz",
            "2 S R / c",
            farthest,
        ),
        (
            "max_doppler_frequency",
            2
            * requirements.max_velocity_m_per_s
            * requirements.carrier_hz
            / speed_of_light_m_per_s,
            "Hz",
            "2 v f / c",
            f"{fastest}, f = carrier",
        ),
        (
            "range_doppler_coupling",
            chirp.range_doppler_coupling_m(requirements.max_velocity_m_per_s),
            "m",
            "v f_mid / S",
            f"{fastest}, f at mid-window",
        ),
        ("range_resolution", chirp.range_resolution_m * scale, "m", "c / 2 B", sampled),
        ("max_range", chirp.max_range_m * scale, "m", alias_formula, f"{chirp.sampling} samples"),
        ("interval", frame.single_interval_s, "s", "T", "start to start"),
        ("max_velocity", frame.max_velocity_m_per_s * scale, "m/s", "lambda / 4 T", middle),
        ("n_chirps", frame.n_chirps, "1", "M", "128, or lambda / (2 T dv) rounded up"),
        (
            "velocity_resolution",
            frame.velocity_resolution_m_per_s * scale,
            "m/s",
            "lambda / 2 M T",
            middle,
        ),
        ("frame_duration", frame.duration_s, "s", "M T", ""),
        (
            "integration_gain",
            radar.integration_gain,
            "1",
            _integration_gain_formula(radar),
            "no windows",
        ),
        ("data_rate", data_rate_bits_per_s(radar), "bit/s", "8 cube / M T", "16-bit words"),
        ("cube_memory", frame_cube_bytes(radar), "byte", size_formula, "16-bit words"),
        ("eirp", radar.require_hardware().eirp_w, "W", "P Gt", "while the ramp lasts"),
        ("mean_eirp", mean_eirp_w(radar), "W", "P Gt T_ramp / T", ""),
    ]
    beamwidth_rad = radar.array.azimuth_beamwidth_rad(chirp.wavelength_m)
    if not math.isnan(beamwidth_rad):
        formula = "0.886 lambda / N d"
        rows.append(("azimuth_beamwidth", beamwidth_rad, "rad", formula, "N elements, d apart"))
    return tuple(
        DerivedValue(name=name, value=number, unit=unit, formula=formula, symbols=uses)
        for name, number, unit, formula, uses in rows
    )


def _integration_gain_formula(radar: Radar) -> str:
    return "N M n_rx" if radar.frame.chirp.sampling == "complex" else "N M n_rx / 2"
