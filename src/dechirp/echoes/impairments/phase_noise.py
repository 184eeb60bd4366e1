"""Phase noise of the oscillator, from its single-sideband mask."""

import math
import warnings
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import irfft, next_fast_len

from dechirp.core.checks import listed, series
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import must_fit
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Oscillator
from dechirp.echoes.parts import Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

# Bytes for each sample of the process: its spectrum, and sizes as they are made from the mask.
_SAMPLE_BYTES = 40


@value
class PhaseNoise(Oscillator):
    r"""One Gaussian process, without a gap over the chirps of a frame, that all channels share.

    The mask L(f) is the power in 1 Hz, f from the carrier on either side, over that of the
    carrier; straight in dB over log f between its points, constant beyond them. The phase has
    the one-sided density 2 L(f). An echo after the delay tau has cancelled what is slow, and
    has a skirt on each side of its beat frequency of

    .. math:: 4 \sin^2(\pi f \tau) L(f).

    Frames are independent. The process is sampled with the echoes: from 0 to half the sample
    rate, and chirps begin at the sample nearest to when they do.

    References
    ----------
    M. C. Budge & M. P. Burt, Range correlation effects in radars, IEEE Nat. Radar Conf., 1993.
    P. D. L. Beasley, The influence of transmitter phase noise on FMCW radar performance, EuRAD,
    2006.
    """

    offset_hz: tuple[float, ...]
    """Ascending, from the carrier."""
    level_per_hz: tuple[float, ...]
    """At each offset: ratios of powers (dBc/Hz in files)."""

    def __post_init__(self) -> None:
        offsets = _points("PhaseNoise.offset_hz", self.offset_hz, 1e-6, 1e13)
        # Above the carrier it is none, and no oscillator is 400 dB under it.
        levels = _points("PhaseNoise.level_per_hz", self.level_per_hz, 1e-40, 1.0)
        for place in range(1, len(offsets)):
            if offsets[place] <= offsets[place - 1]:
                raise InvalidSetting(
                    f"PhaseNoise.offset_hz.{place}",
                    got=f"{offsets[place]:.6g} Hz, after {offsets[place - 1]:.6g} Hz",
                    need="above the one before it",
                    fix="Put the offsets in ascending order, each once.",
                )
        if len(levels) != len(offsets):
            raise InvalidSetting(
                "PhaseNoise.level_per_hz",
                got=f"{len(levels)} levels",
                need=f"{len(offsets)}, one for each offset",
                fix="Give both lists the same length.",
            )
        object.__setattr__(self, "offset_hz", offsets)
        object.__setattr__(self, "level_per_hz", levels)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn of a mask that samples do not reach, or that leaves no echo."""
        nyquist_hz = radar.frame.chirp.sample_rate_hz / 2
        if self.offset_hz[0] >= nyquist_hz:
            self._warn(
                "offset",
                got=f"from {self.offset_hz[0]:.4g} Hz on",
                need=f"some offset below {nyquist_hz:.4g} Hz, half the sample rate: the level of"
                " the first is used for all",
                fix="Add nearer offsets, or check their unit.",
            )
        if not scene.targets:
            return
        ranges_m = np.linalg.norm(scene.positions_m([radar.frame.mid_frame_s])[0], axis=-1)
        left_rad = self.left_rad(2 * float(ranges_m.max()) / SPEED_OF_LIGHT, nyquist_hz)
        if left_rad > 1:
            self._warn(
                "level",
                got=f"phase noise of {left_rad:.3g} rad rms on the farthest echo",
                need="at most 1 rad for an echo to stay a line with a skirt",
                fix="Check the sign of the levels, and that they are in 1 Hz.",
            )

    def left_rad(self, delay_s: float, up_to_hz: float) -> float:
        """Root mean square of the phase noise that is left after a delay, up to an offset."""
        offset_hz = np.geomspace(min(1.0, up_to_hz / 1e6), up_to_hz, 4001)
        density = 2 * self.level_at(offset_hz) * 4 * np.sin(np.pi * offset_hz * delay_s) ** 2
        return math.sqrt(np.trapezoid(density, offset_hz))

    def level_at(self, offset_hz: np.ndarray) -> np.ndarray:
        """The mask at offsets above 0, in 1 Hz."""
        logs = np.log(self.offset_hz), np.log(self.level_per_hz)
        return np.exp(np.interp(np.log(offset_hz), *logs))

    def phase_rad(self, window: Window, radar: Radar, rng: np.random.Generator) -> np.ndarray:
        """Draw the process for a frame, and take the times of each chirp from it.

        Raises
        ------
        NotEnoughMemory
            If the frame has more samples than fit, pauses between chirps included.
        """
        firsts = np.rint(window.starts_s * window.rate_hz).astype(np.int64)
        firsts -= firsts[0]
        n_needed = int(firsts[-1]) + window.n_times
        # What is made in frequency repeats: of twice the length, half is a piece of a process
        # that goes on.
        n = next_fast_len(2 * n_needed, real=True)
        must_fit(
            "phase noise", needed_bytes=_SAMPLE_BYTES * n, fix="Simulate fewer chirps in a frame."
        )
        # Single precision errs by 1e-7 of the phase, as white noise: over all the band 140 dB
        # below the phase noise.
        drawn = rng.standard_normal(n // 2 * 2, np.float32).view(np.complex64)
        spectrum = np.zeros(n // 2 + 1, np.complex64)
        np.multiply(drawn, _sizes(self, n, window.rate_hz), out=spectrum[1:])
        process_rad = irfft(spectrum, n)
        return sliding_window_view(process_rad, window.n_times)[firsts].astype(float)

    def _warn(self, setting: str, *, got: str, need: str, fix: str) -> None:
        finding = Finding(
            level="warning", setting=f"impairments.phase-noise.{setting}",
            got=got, need=need, fix=fix,
        )  # fmt: skip
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


@lru_cache(maxsize=2)
def _sizes(mask: PhaseNoise, n: int, rate_hz: float) -> np.ndarray:
    """Standard deviation of each part of n // 2 bins above 0, the same for all frames.

    A constant phase is not seen, and has none.
    """
    bins_hz = np.arange(1, n // 2 + 1) * (rate_hz / n)
    sizes = np.sqrt(mask.level_at(bins_hz) * (n * rate_hz / 2)).astype(np.float32)
    sizes.flags.writeable = False
    return sizes


def _points(where: str, given: object, at_least: float, at_most: float) -> tuple[float, ...]:
    members = listed(given)
    if not members:
        raise InvalidSetting(
            where, got=given, need="a list of at least one number", fix="Write [1e6], or a mask."
        )
    return series(where, members, at_least=at_least, at_most=at_most)
