"""IF filters between mixer and ADC: high-pass against leakage, low-pass against aliases."""

import warnings

import numpy as np

from dechirp.core.checks import check_integer_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import format_si
from dechirp.core.units import to_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.aliasing import RangeVelocity, beat_and_doppler_frequencies
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth
from dechirp.simulation.blocks import apply_to_chirp_blocks
from dechirp.simulation.frequency_response import (
    TOLERANCE,
    ImpulseExtent,
    impulse_response,
    make_chirp_convolver,
    significant_impulse_extent,
)
from dechirp.simulation.impairments.base import Receiver


@frozen_dataclass
class IfFilter(Receiver):
    r"""Butterworth high-pass and low-pass, as analog filters, 3 dB down at their corners.

    .. math:: |H|^2 = \frac{1}{1 + (f_h / f)^{2 n_h}} \frac{1}{1 + (f / f_l)^{2 n_l}}

    with their phases; both filter I and Q alike. From 0 to nine tenths of the band of beats, the
    response of the samples matches this one within 0.002 (0.02 dB in the passband; attenuation
    beyond
    54 dB may be limited to it, except near frequency 0). Above, it passes into the response of the
    smallest negative beats, see `frequency_response.py`. The filter has settled at the first
    sample:
    echoes extend before it, and their onset causes no transient. Samples are already aliased, so
    echoes beyond the maximum range are filtered at their apparent beat frequency.

    References
    ----------
    S. Butterworth, On the theory of filter amplifiers, 1930.
    """

    high_pass_hz: float | None = 350e3
    """Corner frequency below which near echoes and leakage are attenuated; none: no high-pass."""
    high_pass_order: int = 2
    """Order of the high-pass: 6 dB an octave for each."""
    low_pass_hz: float | None = None
    """Corner frequency above which far echoes are attenuated; none: no low-pass."""
    low_pass_order: int = 4
    """Order of the low-pass: 6 dB an octave for each."""

    def __post_init__(self) -> None:
        check_integer_fields(self, "high_pass_order", "low_pass_order", at_most=8)
        for name in ("high_pass_hz", "low_pass_hz"):
            if getattr(self, name) is not None:
                check_positive_fields(self, name, at_least=1e-3, at_most=1e13)
        low_hz, high_hz = self.low_pass_hz, self.high_pass_hz
        if low_hz is None and high_hz is None:
            raise InvalidSetting(
                "IfFilter.high_pass_hz",
                value="missing, and low_pass as well",
                expected="at least one corner frequency",
                fix="give one, or remove if-filter",
            )
        if low_hz is not None and high_hz is not None and low_hz <= high_hz:
            raise InvalidSetting(
                "IfFilter.low_pass_hz",
                value=format_si(low_hz, "hz"),
                expected=f"above that of the high-pass, {format_si(high_hz, 'hz')}: else nothing"
                " passes",
                fix="swap the corners, or check their units",
            )

    def response(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Return the complex gain at frequencies of either sign, any shape."""
        frequency_hz = np.asarray(frequency_hz, dtype=float)
        gain = np.ones(frequency_hz.shape, complex)
        if self.high_pass_hz is not None:
            s = 1j * frequency_hz / self.high_pass_hz
            for pole in _butterworth_poles(self.high_pass_order):
                gain *= s / (1 - s * pole)
        if self.low_pass_hz is not None:
            s = 1j * frequency_hz / self.low_pass_hz
            for pole in _butterworth_poles(self.low_pass_order):
                gain /= s - pole
        return gain

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if a corner is outside the band; warn about attenuated echoes."""
        chirp = radar.frame.chirp
        max_beat_hz = chirp.max_beat_frequency_hz
        for name in ("high_pass", "low_pass"):
            corner_hz = getattr(self, f"{name}_hz")
            if corner_hz is not None and corner_hz >= max_beat_hz:
                raise InvalidSetting(
                    name,
                    value=f"{corner_hz / 1e6:.6g} MHz",
                    expected=f"below {max_beat_hz / 1e6:.6g} MHz, the highest beat of"
                    f" {chirp.sampling} samples at {chirp.sample_rate_hz / 1e6:.6g} MS/s",
                    fix="lower the corner, or sample faster",
                )
        interval_s = radar.frame.single_interval_s
        settles_s = self._settling_time_s()
        if settles_s > interval_s:
            raise InvalidSetting(
                "low_pass" if self.high_pass_hz is None else "high_pass",
                value=f"a corner so low that the filter rings for {settles_s * 1e6:.4g} us",
                expected=f"settling within {interval_s * 1e6:.4g} us, from one chirp to the next",
                fix="raise the corner, or lower the order",
            )
        self._warn_of_attenuated_targets(scene, radar)

    def _warn_of_attenuated_targets(self, scene: Scene, radar: Radar) -> None:
        if not scene.targets:
            return
        truth_table = truth(scene, radar).isel(frame=0)
        beat_hz = beat_and_doppler_frequencies(
            RangeVelocity(truth_table.range.values, truth_table.velocity.values), radar
        ).beat_hz
        lost_db = -to_decibels(np.maximum(np.abs(self.response(beat_hz)) ** 2, 1e-30))
        is_aliased = (beat_hz < 0) | (beat_hz >= radar.frame.chirp.max_beat_frequency_hz)
        attenuated = np.flatnonzero((lost_db > 3.01) & ~is_aliased)
        if attenuated.size:
            worst = attenuated[np.argmax(lost_db[attenuated])]
            others = f", and {attenuated.size - 1} more targets by more than 3 dB" * (
                attenuated.size > 1
            )
            finding = Finding(
                level="warning",
                setting="impairments.if-filter",
                value=f"{scene.names[worst]} is attenuated by {lost_db[worst]:.1f} dB, at a beat of"
                f" {beat_hz[worst] / 1e6:.4g} MHz{others}",
                expected="beats between the corners of the filter",
                fix="move the corner or the target, or change the slope",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=2)

    def sample_margins(self, radar: Radar) -> tuple[int, int]:
        """Return the samples until the filter has settled, and the few that shape its band."""
        return significant_impulse_extent(self._impulse_response(radar.frame.chirp))

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        impulse = self._impulse_response(radar.frame.chirp)
        convolve = make_chirp_convolver(
            samples, impulse, ImpulseExtent(*self.sample_margins(radar))
        )

        def apply_filter(chirps: np.ndarray) -> None:
            chirps[...] = convolve(chirps)

        apply_to_chirp_blocks(samples, apply_filter)

    def _impulse_response(self, chirp: Chirp) -> np.ndarray:
        return impulse_response(self.response, chirp, settling_time_s=self._settling_time_s())

    def _settling_time_s(self) -> float:
        """Return the time after which the slowest transient is within the tolerance."""
        corners = (self.high_pass_hz, self.high_pass_order), (self.low_pass_hz, self.low_pass_order)
        slowest = min(
            2 * np.pi * corner_hz * -_butterworth_poles(order).real.max()
            for corner_hz, order in corners
            if corner_hz is not None
        )
        return float(np.log(1 / TOLERANCE) / slowest)


def _butterworth_poles(order: int) -> np.ndarray:
    """Return the poles of the Butterworth low-pass with its corner at 1 rad/s, (order,)."""
    return np.exp(1j * np.pi * (2 * np.arange(order) + order + 1) / (2 * order))
