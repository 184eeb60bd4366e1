"""
The beat signal of one target
=============================

A ramp that is mixed with its own echo leaves a tone. Its frequency tells the range, :math:`f_b =
2 S R / c`, S the slope of the ramp (Stove, IEE Proceedings F 139, 1992). See the tone in the
noise of one chirp, and its line where the formula has it.
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

figure, (left, right) = plt.subplots(1, 2)
left.plot(chirp.sample * 1e6, chirp.real * 1e6, label="I")
left.plot(chirp.sample * 1e6, chirp.imag * 1e6, label="Q")
left.set(xlabel="Time since ramp start (µs)", ylabel="Beat signal (sqrt(pW))")
left.set(xlim=(2, 14), ylim=(-3.3, 4))
left.legend(loc="upper right", ncols=2)
right.plot(beat_hz / 1e6, 20 * np.log10(abs(spectrum)) + 30)
right.axvline(expected_hz / 1e6, color="C1", linestyle=":", label="2 S R / c")
right.set(xlabel="Beat frequency (MHz)", ylabel="Power (dBm)", ylim=(-130, None))
right.legend()
figure.suptitle("An echo from 12 m is a tone of 0.8 MHz")
