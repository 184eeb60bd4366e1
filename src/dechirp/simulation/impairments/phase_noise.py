"""Phase noise of the oscillator, from its single-sideband mask."""

import math
import warnings
from functools import lru_cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from dechirp.core.checks import as_tuple_or_none, check_numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import check_free_memory
from dechirp.core.text import format_si
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import SampleWindow
from dechirp.simulation.impairments.base import Oscillator

# Bytes for each sample of the process: its spectrum, and the standard deviations from the mask.
_SAMPLE_BYTES = 40


@frozen_dataclass
class PhaseNoise(Oscillator):
    r"""Gaussian phase noise, continuous over the chirps of a frame and common to all channels.

    The mask L(f) is the power in 1 Hz at the offset f from the carrier on either side, over that of
    the carrier; linear in dB over log f between its points, constant beyond them. The phase has the
    one-sided density 2 L(f). After the delay tau, slow phase noise of an echo has cancelled, and
    its
    skirt on each side of the beat frequency is

    .. math:: 4 \sin^2(\pi f \tau) L(f).

    A map shows the mean of the skirt over the main lobe of its window, which matters beside the
    zeros of the sine and where the mask is steep: at 75 to 130 m the skirt itself differs by up to
    0.9 dB with 40 dB a decade and by 3.6 dB with 50 dB, where the square of the sine is above 0.1.
    Cells of a map of N chirps scatter by 4.3 / sqrt(N) dB.

    Frames are independent. The process has offsets from 0 to the sample rate, so that the skirt of
    an echo at one end of the band of beats extends to the other. The receiver passes beats from 0
    to the sample rate, or of real samples up to half of it on either side of 0; noise beyond is
    left out. An echo within a cell of an end moves this band by whole cells, until a whole cell
    beside the echo passes. The cells at one end of a map contain sidelobes of the noise at the
    other: theory needs the main lobe and the sidelobes of the window over the passed band. Then
    every cell of the map is within 0.5 dB. Chirps begin at the half sample nearest to their start.

    References
    ----------
    M. C. Budge & M. P. Burt, Range correlation effects in radars, IEEE Nat. Radar Conf., 1993.
    P. D. L. Beasley, The influence of transmitter phase noise on FMCW radar performance, EuRAD,
    2006.
    """

    offset_hz: tuple[float, ...]
    """Offsets from the carrier, ascending."""
    level_per_hz: tuple[float, ...]
    """Mask at each offset: ratios of powers (dBc/Hz in files)."""

    def __post_init__(self) -> None:
        offsets = _check_mask_values("PhaseNoise.offset_hz", self.offset_hz, 1e-6, 1e13)
        # A level above the carrier is not noise, and no oscillator is 400 dB below it.
        levels = _check_mask_values("PhaseNoise.level_per_hz", self.level_per_hz, 1e-40, 1.0)
        for index in range(1, len(offsets)):
            if offsets[index] <= offsets[index - 1]:
                raise InvalidSetting(
                    f"PhaseNoise.offset_hz.{index}",
                    value=f"{format_si(offsets[index], 'hz')}, after"
                    f" {format_si(offsets[index - 1], 'hz')}",
                    expected="above the one before it",
                    fix="put the offsets in ascending order, each once",
                )
        if len(levels) != len(offsets):
            raise InvalidSetting(
                "PhaseNoise.level_per_hz",
                value=f"{len(levels)} levels",
                expected=f"{len(offsets)}, one for each offset",
                fix="give both lists the same length",
            )
        object.__setattr__(self, "offset_hz", offsets)
        object.__setattr__(self, "level_per_hz", levels)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn about a mask beyond the sampled offsets, or one that destroys the echo."""
        highest_hz = radar.frame.chirp.sample_rate_hz
        if self.offset_hz[0] >= highest_hz:
            self._issue_setting_warning(
                "offset",
                value=f"from {format_si(self.offset_hz[0], 'hz', 4)} on",
                expected=f"an offset below {format_si(highest_hz, 'hz', 4)}, the sample rate; the"
                " level of the"
                " first offset is used for all",
                fix="add nearer offsets, or check their unit",
            )
        if not scene.targets:
            return
        ranges_m = np.linalg.norm(
            scene.scatterer_positions_m([radar.frame.mid_frame_s])[0], axis=-1
        )
        residual_rad = self.residual_rms_rad(2 * float(ranges_m.max()) / SPEED_OF_LIGHT, highest_hz)
        if residual_rad > 1:
            self._issue_setting_warning(
                "level",
                value=f"phase noise of {residual_rad:.3g} rad rms on the farthest echo",
                expected="at most 1 rad, so that an echo remains a line with a skirt",
                fix="check the sign of the levels, and that they refer to 1 Hz",
            )

    def residual_rms_rad(self, delay_s: float, up_to_hz: float) -> float:
        """Return the root mean square of the phase noise after a delay, up to an offset."""
        offset_hz = np.geomspace(min(1.0, up_to_hz / 1e6), up_to_hz, 4001)
        density = (
            2 * self.interpolate_mask(offset_hz) * 4 * np.sin(np.pi * offset_hz * delay_s) ** 2
        )
        return math.sqrt(np.trapezoid(density, offset_hz))

    def interpolate_mask(self, offset_hz: np.ndarray) -> np.ndarray:
        """Return the mask at offsets above 0, per Hz."""
        logs = np.log(self.offset_hz), np.log(self.level_per_hz)
        return np.exp(np.interp(np.log(offset_hz), *logs))

    def phase_error_rad(
        self, window: SampleWindow, radar: Radar, rng: np.random.Generator
    ) -> np.ndarray:
        """Draw the process of a frame, and take the samples of each chirp from it.

        Raises
        ------
        NotEnoughMemory
            If the frame has more samples than fit, pauses between chirps included.
        """
        firsts = np.rint(window.chirp_starts_s * window.rate_hz).astype(np.int64)
        firsts -= firsts[0]
        n_needed = int(firsts[-1]) + window.n_times
        # A process made in the frequency domain is periodic: half of one of twice the length is
        # not.
        n = scipy.fft.next_fast_len(2 * n_needed, real=True)
        check_free_memory(
            "phase noise", needed_bytes=_SAMPLE_BYTES * n, fix="simulate fewer chirps in a frame"
        )
        # Single precision errs by 1e-7 of the phase, as white noise 140 dB below the phase noise
        # over the band.
        spectrum = np.zeros(n // 2 + 1, np.complex64)
        normals = spectrum[1:].view(np.float32)
        rng.standard_normal(dtype=np.float32, out=normals)
        spectrum[1:] *= _bin_standard_deviations(self, n, window.rate_hz)
        process_rad = scipy.fft.irfft(spectrum, n, overwrite_x=True)
        return sliding_window_view(process_rad, window.n_times)[firsts].astype(float)

    def _issue_setting_warning(self, setting: str, *, value: str, expected: str, fix: str) -> None:
        finding = Finding(
            level="warning", setting=f"impairments.phase-noise.{setting}",
            value=value, expected=expected, fix=fix,
        )  # fmt: skip
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


@lru_cache(maxsize=2)
def _bin_standard_deviations(mask: PhaseNoise, n_fft: int, rate_hz: float) -> np.ndarray:
    """Return the standard deviation of both parts of n // 2 bins above 0, the same for all frames.

    A constant phase has no effect, so bin 0 is omitted.
    """
    bins_hz = np.arange(1, n_fft // 2 + 1) * (rate_hz / n_fft)
    sizes = np.sqrt(mask.interpolate_mask(bins_hz) * (n_fft * rate_hz / 2)).astype(np.float32)
    sizes.flags.writeable = False
    return sizes


def _check_mask_values(
    setting: str, values: object, at_least: float, at_most: float
) -> tuple[float, ...]:
    members = as_tuple_or_none(values)
    if not members:
        raise InvalidSetting(
            setting,
            value=values,
            expected="a list of at least one number",
            fix="write [1e6], or a mask",
        )
    return check_numbers(setting, members, at_least=at_least, at_most=at_most)
