"""
The beat signal of one target
=============================

Mixing a ramp with its own echo gives a tone. Its frequency is proportional to range,
:math:`f_b = 2 S R / c`, where S is the slope of the ramp (Stove, IEE Proceedings F 139, 1992). The
figure shows the tone in the noise of one chirp, and its spectral line at the predicted frequency.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=100, range_resolution_m=0.5, max_velocity_m_per_s=30, rule="constraints"
).radar
scene = dc.Scene(targets=[dc.Target(position_m=(12, 0, 0), rcs_m2=10)])
chirp = dc.simulate(scene, radar, seed=1).isel(frame=0, chirp=0, rx=0)

n = chirp.size
spectrum = np.fft.fft(chirp * np.hanning(n), 16 * n) / np.hanning(n).sum()
beat_hz = np.arange(16 * n) * radar.frame.chirp.sample_rate_hz / (16 * n)
expected_hz = radar.frame.chirp.beat_frequency_hz(12)
print(f"line at {beat_hz[abs(spectrum).argmax()] / 1e3:.1f} kHz, 2 S R / c {expected_hz / 1e3:.1f}")

figure, (time_axes, spectrum_axes) = plt.subplots(1, 2)
time_axes.plot(chirp.sample * 1e6, chirp.real * 1e6, label="I")
time_axes.plot(chirp.sample * 1e6, chirp.imag * 1e6, label="Q")
time_axes.set(xlabel="Time since ramp start (µs)", ylabel="Beat signal (√pW)")
time_axes.set(xlim=(2, 14), ylim=(-3.3, 4))
time_axes.legend(loc="upper right", ncols=2)
spectrum_axes.plot(beat_hz / 1e6, 20 * np.log10(abs(spectrum)) + 30)
spectrum_axes.axvline(expected_hz / 1e6, color="C1", linestyle=":", label="2 S R / c")
spectrum_axes.set(xlabel="Beat frequency (MHz)", ylabel="Power (dBm)", ylim=(-130, None))
spectrum_axes.legend()
figure.suptitle("An echo from 12 m is a tone of 0.8 MHz")
