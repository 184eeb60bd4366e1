"""Tones of a sound card in a continuous recording: independent of the ramps, and thus no echoes.

Sound cards add tones at multiples of 1 kHz, the rate of USB frames. In a frame a tone looks like an
echo at the range of its frequency, with a velocity that depends on the interval of the
chirps. The samples between the chirps distinguish both: echoes repeat with the ramps, so their
spectrum is a comb of lines at distances of 1 / T, T from a ramp to the next, of which at least two
lie within the main lobe of a ramp. A tone is one line.

A line is a tone if the median over segments of 1.5 s, which removes what moves, exceeds the median
of its neighbourhood by 9 dB, and the lines of a comb beside it, at distances of 1 / T and 2 / T, by
8 dB. Lines at multiples of 1 / T belong to static echoes, and stay. Both sides of a triangle may
interfere so that a vibrating target has a single line as well: only lines at multiples of 1 kHz,
within the errors of the clocks, are tones.

Amplitude and phase of a tone are estimated in windows of 1.5 s. Their subtraction removes a band of
0.7 Hz; an echo at the range of a tone loses 3 % of a line of its comb, whose distance is 24 Hz.
"""

import math
from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np

# A window of 1.5 s at 44.1 kHz.
_WINDOW_S = 1.5
_MAX_SEGMENTS = 64
_MIN_OVER_FLOOR, _MIN_OVER_COMB = 8.0, 6.3
_FLOOR_BAND_HZ = 100.0
_USB_FRAME_RATE_HZ = 1000.0
# Difference of two clocks: 50 parts in 1e6 each.
_MAX_CLOCK_ERROR = 1e-4
# Bins around the lines of a comb, which are a Hann window's main lobe wide.
_LINE_HALF_WIDTH = 2


class StationaryTones:
    """Tones of a recording, found at first use.

    Parameters
    ----------
    read_samples : callable
        Returns samples by the index of the first and their number, (n,).
    n_samples, sample_rate_hz
        Of the whole recording.
    ramp_interval_s : float
        Mean interval from a ramp to the next.
    chirp_starts : array (frame, chirp)
        First sample of each chirp; -1 where it is missing.
    n_chirp_samples : int
        Samples of a chirp.
    """

    def __init__(
        self,
        read_samples: Callable[[int, int], np.ndarray],
        *,
        n_samples: int,
        sample_rate_hz: float,
        ramp_interval_s: float,
        chirp_starts: np.ndarray,
        n_chirp_samples: int,
    ) -> None:
        self._read_samples, self._n_samples = read_samples, n_samples
        self._rate_hz, self._interval_s = sample_rate_hz, ramp_interval_s
        self._chirp_starts, self._n_chirp_samples = chirp_starts, n_chirp_samples
        self._n_window = 2 ** round(math.log2(_WINDOW_S * sample_rate_hz))
        self._amplitudes_at_hop = lru_cache(maxsize=8)(self._estimate_amplitudes)

    @cached_property
    def _window(self) -> np.ndarray:
        # At 10 MHz, 2^24 values: 0.9 s, of which short recordings need nothing.
        return np.asarray(np.hanning(self._n_window + 1)[:-1], np.float32)

    @cached_property
    def frequencies_hz(self) -> np.ndarray:
        """Frequencies of the tones, ascending; empty in recordings shorter than two windows."""
        n_window, step_hz = self._n_window, self._rate_hz / self._n_window
        if self._n_samples < 2 * n_window:
            return np.zeros(0)
        n_segments = min(2 * (self._n_samples // n_window) - 1, _MAX_SEGMENTS)
        starts = np.linspace(0, self._n_samples - n_window, n_segments).astype(int)
        spectra = np.array([self._segment_power(start) for start in starts.tolist()])
        power = np.median(spectra, axis=0)
        frequency_hz = step_hz * np.arange(power.size)
        bins = np.arange(-_LINE_HALF_WIDTH, _LINE_HALF_WIDTH + 1)
        comb = np.zeros_like(power)
        for n_lines in (-2, -1, 1, 2):
            shift = round(n_lines / (self._interval_s * step_hz))
            comb = np.maximum(comb, np.max([np.roll(power, shift + k) for k in bins], axis=0))
        multiple = np.round(frequency_hz / _USB_FRAME_RATE_HZ)
        from_multiple_hz = abs(frequency_hz - multiple * _USB_FRAME_RATE_HZ)
        from_ramp_line_hz = (
            0.5 - abs(frequency_hz * self._interval_s % 1 - 0.5)
        ) / self._interval_s
        is_peak = (power > np.roll(power, 1)) & (power >= np.roll(power, -1))
        is_peak &= (multiple > 0) & (from_multiple_hz < _MAX_CLOCK_ERROR * frequency_hz + step_hz)
        is_peak &= (from_ramp_line_hz > 1.5 * step_hz) & (power > _MIN_OVER_COMB * comb)
        half_band = round(_FLOOR_BAND_HZ / 2 / step_hz)
        tones = [
            step_hz * (k + _peak_offset(power, k))
            for k in np.flatnonzero(is_peak).tolist()
            if power[k] > _MIN_OVER_FLOOR * np.median(power[max(k - half_band, 0) : k + half_band])
        ]
        return np.array(tones)

    @cached_property
    def _turns_per_sample(self) -> np.ndarray:
        return self.frequencies_hz / self._rate_hz

    @cached_property
    def _chirp_phasors(self) -> np.ndarray:
        """Phasors of the tones from the start of a chirp on, (tone, sample)."""
        index = np.arange(self._n_chirp_samples)
        return np.asarray(np.exp(2j * np.pi * (self._turns_per_sample[:, None] * index)))

    def in_frame(self, number: int) -> np.ndarray:
        """Return the tones in the chirps of a frame, (chirp, sample); zero in missing chirps."""
        starts = self._chirp_starts[number]
        tones = np.zeros((len(starts), self._n_chirp_samples), np.float32)
        if not self.frequencies_hz.size:
            return tones
        for chirp, start in enumerate(starts.tolist()):
            if start >= 0:
                tones[chirp] = self._evaluate(start)
        return tones

    def _segment_power(self, start: int) -> np.ndarray:
        samples = self._finite_samples(start, self._n_window)
        return np.asarray(abs(np.fft.rfft(samples * self._window)) ** 2)

    def _finite_samples(self, start: int, n_samples: int) -> np.ndarray:
        samples = self._read_samples(start, n_samples)
        return np.where(np.isfinite(samples), samples, np.float32(0))

    def _evaluate(self, start: int) -> np.ndarray:
        """Return the sum of all tones from a sample on, (sample,)."""
        hop = self._n_window // 2
        last_hop = (self._n_samples - self._n_window) // hop
        # Amplitudes belong to the middles of their windows, between which they are interpolated.
        position = np.clip((start + self._n_chirp_samples / 2) / hop - 1, 0, last_hop)
        lower = min(int(position), max(last_hop - 1, 0))
        weight = position - lower
        amplitudes = (1 - weight) * self._amplitudes_at_hop(lower)
        amplitudes = amplitudes + weight * self._amplitudes_at_hop(min(lower + 1, last_hop))
        amplitudes = amplitudes * np.exp(2j * np.pi * (self._turns_per_sample * start % 1))
        # Plain sums: threads of a matrix product take 26 ms for 0.1 ms of work.
        return np.asarray((amplitudes[:, None] * self._chirp_phasors).real.sum(axis=0))

    def _estimate_amplitudes(self, hop_number: int) -> np.ndarray:
        """Return the complex amplitudes of the tones in a window, with the phase at sample 0."""
        start = hop_number * (self._n_window // 2)
        samples = self._finite_samples(start, self._n_window) * self._window
        index = start + np.arange(self._n_window)
        scale = 2 / float(self._window.sum())
        return np.array(
            [
                scale * (samples * np.exp(-2j * np.pi * (turns * index % 1))).sum()
                for turns in self._turns_per_sample
            ]
        )


def _peak_offset(power: np.ndarray, k: int) -> float:
    """Return the offset of a peak from its bin, by a parabola through the levels."""
    if not 0 < k < power.size - 1:
        return 0.0
    left, middle, right = np.log(power[k - 1 : k + 2] + 1e-300)
    curvature = left - 2 * middle + right
    return float(0.5 * (left - right) / curvature) if curvature < 0 else 0.0
