"""The filters between mixer and converter: against leakage below, against aliases above."""

import warnings

import numpy as np

from dechirp.core.checks import count, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.units import decibels
from dechirp.core.values import value
from dechirp.echoes.analog import TOLERANCE, Reach, convolution, impulse_response, reach
from dechirp.echoes.impairments.base import Receiver
from dechirp.echoes.pieces import in_pieces
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, frequencies
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth


@value
class IfFilter(Receiver):
    r"""Butterworth high-pass and low-pass, as analog filters, 3 dB down at their corners.

    .. math:: |H|^2 = \frac{1}{1 + (f_h / f)^{2 n_h}} \frac{1}{1 + (f / f_l)^{2 n_l}}

    with their phases; both filter I and Q alike. From 0 to nine tenths of the band of beats the
    response of the samples is this one but for 0.002 (0.02 dB where nothing is cut; what is cut by
    more than 54 dB may come through with that, nearest to frequency 0 less). Above, it passes over
    to the response of the smallest negative beats, see `analog.py`. Settled at the first sample:
    echoes are there before it, but are not turned on. What was sampled already has folded, and no
    filter tells it from what it folds to: echoes beyond the largest range pass as where they seem.

    References
    ----------
    S. Butterworth, On the theory of filter amplifiers, 1930.
    """

    high_pass_hz: float | None = 350e3
    """Corner below which near echoes and leakage are cut; none: no high-pass."""
    high_pass_order: int = 2
    low_pass_hz: float | None = None
    """Corner above which far echoes are cut; none: no low-pass."""
    low_pass_order: int = 4

    def __post_init__(self) -> None:
        count(self, "high_pass_order", "low_pass_order", at_most=8)
        for name in ("high_pass_hz", "low_pass_hz"):
            if getattr(self, name) is not None:
                positive(self, name, at_least=1e-3, at_most=1e13)
        low, high = self.low_pass_hz, self.high_pass_hz
        if low is None and high is None:
            raise InvalidSetting(
                "IfFilter.high_pass_hz",
                got="none, and no low_pass either",
                need="a corner of one of them at least",
                fix="Give one, or leave if-filter out.",
            )
        if low is not None and high is not None and low <= high:
            raise InvalidSetting(
                "IfFilter.low_pass_hz",
                got=f"{low:.6g} Hz",
                need=f"above that of the high-pass, {high:.6g} Hz: nothing passes both",
                fix="Exchange the corners, or check their units.",
            )

    def response(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Complex gain at frequencies of either sign, any shape."""
        frequency_hz = np.asarray(frequency_hz, dtype=float)
        gain = np.ones(frequency_hz.shape, complex)
        if self.high_pass_hz is not None:
            s = 1j * frequency_hz / self.high_pass_hz
            for pole in _poles(self.high_pass_order):
                gain *= s / (1 - s * pole)
        if self.low_pass_hz is not None:
            s = 1j * frequency_hz / self.low_pass_hz
            for pole in _poles(self.low_pass_order):
                gain /= s - pole
        return gain

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where a corner is outside the band; warn of echoes that are cut."""
        chirp = radar.frame.chirp
        most_hz = chirp.max_beat_frequency_hz
        for name in ("high_pass", "low_pass"):
            corner_hz = getattr(self, f"{name}_hz")
            if corner_hz is not None and corner_hz >= most_hz:
                raise InvalidSetting(
                    name,
                    got=f"{corner_hz / 1e6:.6g} MHz",
                    need=f"below {most_hz / 1e6:.6g} MHz, the highest beat that {chirp.sampling}"
                    f" samples at {chirp.sample_rate_hz / 1e6:.6g} MS/s hold",
                    fix="Lower the corner, or sample faster.",
                )
        interval_s = radar.frame.only_interval_s
        settles_s = self._settles_s()
        if settles_s > interval_s:
            raise InvalidSetting(
                "low_pass" if self.high_pass_hz is None else "high_pass",
                got=f"so low that the filter rings for {settles_s * 1e6:.4g} us",
                need=f"one that settles within {interval_s * 1e6:.4g} us, from a chirp to the next",
                fix="Raise the corner, or lower the order.",
            )
        self._warn_of_cut(scene, radar)

    def _warn_of_cut(self, scene: Scene, radar: Radar) -> None:
        if not scene.targets:
            return
        known = truth(scene, radar).isel(frame=0)
        beat_hz = frequencies(Place(known.range.values, known.velocity.values), radar).beat_hz
        lost_db = -decibels(np.maximum(np.abs(self.response(beat_hz)) ** 2, 1e-30))
        folds = (beat_hz < 0) | (beat_hz >= radar.frame.chirp.max_beat_frequency_hz)
        cut = np.flatnonzero((lost_db > 3.01) & ~folds)
        if cut.size:
            worst = cut[np.argmax(lost_db[cut])]
            others = f", and {cut.size - 1} more targets by more than 3 dB" * (cut.size > 1)
            finding = Finding(
                level="warning",
                setting="impairments.if-filter",
                got=f"{scene.names[worst]} is cut by {lost_db[worst]:.1f} dB, its beat being"
                f" {beat_hz[worst] / 1e6:.4g} MHz{others}",
                need="beats between its corners for echoes to stay",
                fix="Move the corner or the target, or change the slope.",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=2)

    def margins(self, radar: Radar) -> tuple[int, int]:
        """Samples until the filter has settled, and few that make its band."""
        return reach(self._impulse(radar.frame.chirp))

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Filter every chirp."""
        impulse = self._impulse(radar.frame.chirp)
        convolved = convolution(samples, impulse, Reach(*self.margins(radar)))

        def filtered(chirps: np.ndarray) -> None:
            chirps[...] = convolved(chirps)

        in_pieces(samples, filtered)

    def _impulse(self, chirp: Chirp) -> np.ndarray:
        return impulse_response(self.response, chirp, settles_s=self._settles_s())

    def _settles_s(self) -> float:
        """Time after which what rings longest is within the tolerance."""
        corners = (self.high_pass_hz, self.high_pass_order), (self.low_pass_hz, self.low_pass_order)
        slowest = min(
            2 * np.pi * corner_hz * -_poles(order).real.max()
            for corner_hz, order in corners
            if corner_hz is not None
        )
        return float(np.log(1 / TOLERANCE) / slowest)


def _poles(order: int) -> np.ndarray:
    """Poles of the Butterworth low-pass with its corner at 1 rad/s, (order,)."""
    return np.exp(1j * np.pi * (2 * np.arange(order) + order + 1) / (2 * order))
