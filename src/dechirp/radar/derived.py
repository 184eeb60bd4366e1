"""Every number of a design, with the formula it comes from."""

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.core.words import in_unit, number, quantity
from dechirp.radar.radar import Radar
from dechirp.radar.requirements import Requirements

WORD_BYTES = 2  # converters of 12 to 16 bits fill words of 16


@value
class Derived:
    """A number that follows from the requirements."""

    name: str
    value: float
    unit: str
    """SI; `1` for counts and ratios."""
    formula: str
    uses: str = ""
    """What the formula takes its symbols from, where it does not say so itself."""

    @property
    def text(self) -> str:
        """The number with its unit: 150 MHz."""
        if self.unit == "1":
            return number(self.value, 6)
        if self.unit == "Hz/s":
            return in_unit(self.value, "hz_per_s", 6)
        if self.unit == "m/s":
            return in_unit(self.value, "m_per_s", 6)
        return quantity(self.value, self.unit, 6)


def cube_bytes(radar: Radar) -> int:
    """Size of one frame of all receivers, in 16-bit words."""
    chirp = radar.frame.chirp
    words = 2 if chirp.sampling == "complex" else 1
    return chirp.n_samples * radar.frame.n_sent * radar.array.n_rx * words * WORD_BYTES


def data_rate_bits_per_s(radar: Radar) -> float:
    """Bits of all receivers per second, in 16-bit words, mean over a frame."""
    return 8 * cube_bytes(radar) / radar.frame.duration_s


def mean_eirp_w(radar: Radar) -> float:
    """Radiated power times gain, mean over an interval."""
    frame = radar.frame
    return radar.known_hardware().eirp_w * frame.chirp.ramp_duration_s / frame.only_interval_s


def what_follows(
    radar: Radar, asked: Requirements, *, speed_of_light_m_per_s: float
) -> tuple[Derived, ...]:
    """Everything that follows from a radar, whichever rule made it."""
    frame, chirp = radar.frame, radar.frame.chirp
    # The radar's own lengths and velocities come from the exact speed of light.
    scale = speed_of_light_m_per_s / SPEED_OF_LIGHT
    alias = "c fs / 2 S" if chirp.sampling == "complex" else "c fs / 4 S"
    words = "N M n_rx x 4 bytes" if chirp.sampling == "complex" else "N M n_rx x 2 bytes"
    farthest = f"R = {asked.max_range_m:.6g} m"
    fastest = f"v = {asked.max_velocity_m_per_s:.6g} m/s"
    sampled, middle = "B swept while sampling", "lambda at mid-window"
    rows: list[tuple[str, float, str, str, str]] = [
        ("start_frequency", chirp.start_frequency_hz, "Hz", "f0", "the carrier, if in the band"),
        ("ramp_bandwidth", chirp.ramp_bandwidth_hz, "Hz", "S T_ramp", "the whole ramp"),
        ("wavelength", chirp.wavelength_m * scale, "m", "c / f_mid", "f at mid-window"),
        (
            "max_beat_frequency",
            chirp.beat_frequency_hz(asked.max_range_m) / scale,
            "Hz",
            "2 S R / c",
            farthest,
        ),
        (
            "max_doppler_frequency",
            2 * asked.max_velocity_m_per_s * asked.carrier_hz / speed_of_light_m_per_s,
            "Hz",
            "2 v f / c",
            f"{fastest}, f = carrier",
        ),
        (
            "range_doppler_coupling",
            chirp.range_doppler_coupling_m(asked.max_velocity_m_per_s),
            "m",
            "v f_mid / S",
            f"{fastest}, f at mid-window",
        ),
        ("range_resolution", chirp.range_resolution_m * scale, "m", "c / 2 B", sampled),
        ("max_range", chirp.max_range_m * scale, "m", alias, f"{chirp.sampling} samples"),
        ("interval", frame.only_interval_s, "s", "T", "start to start"),
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
        ("integration_gain", radar.integration_gain, "1", _gain(radar), "no windows"),
        ("data_rate", data_rate_bits_per_s(radar), "bit/s", "8 cube / M T", "16-bit words"),
        ("cube_memory", cube_bytes(radar), "byte", words, "16-bit words"),
        ("eirp", radar.known_hardware().eirp_w, "W", "P Gt", "while the ramp lasts"),
        ("mean_eirp", mean_eirp_w(radar), "W", "P Gt T_ramp / T", ""),
    ]
    return tuple(
        Derived(name=name, value=number, unit=unit, formula=formula, uses=uses)
        for name, number, unit, formula, uses in rows
    )


def _gain(radar: Radar) -> str:
    return "N M n_rx" if radar.frame.chirp.sampling == "complex" else "N M n_rx / 2"
