r"""
Breath and heartbeat from the phase
===================================

The phase of an echo turns once per half wavelength of displacement, 2 mm at 77 GHz:
:math:`x = \lambda \phi / 4 \pi` (Droitcour, dissertation, Stanford 2006). The figure shows a
chest that moves 4 mm peak to peak with each breath and 0.4 mm with each heartbeat.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.Radar(
    frame=dc.Frame(
        chirp=dc.Chirp(
            start_frequency_hz=77e9,
            slope_hz_per_s=50e12,
            adc_start_s=2e-6,
            ramp_duration_s=40e-6,
            sample_rate_hz=2e6,
            n_samples=64,
            sampling="complex",
        ),
        n_chirps=480,
        interval_s=50e-3,
    ),
    hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10, noise_factor=16),
)
times_s = np.arange(0, 26, 0.1)
chest_m = 2e-3 * np.sin(2 * np.pi * 0.25 * times_s) + 0.2e-3 * np.sin(2 * np.pi * 1.2 * times_s)
path = [
    dc.Waypoint(time_s=time, position_m=(0.9 + offset, 0, 0))
    for time, offset in zip(times_s[1:], chest_m[1:], strict=True)
]
person = dc.Target(position_m=(0.9, 0, 0), waypoints=path, rcs_m2=0.05)
cube = dc.simulate(dc.Scene(targets=[person]), radar, seed=1)
displacement = dc.slow_time.displacement(dc.slow_time.slow_time(cube, radar, 0.9), radar).squeeze()
spectrum = dc.slow_time.displacement_spectrum(displacement)

figure, (time_axes, spectrum_axes) = plt.subplots(1, 2)
time_axes.plot(displacement.time, displacement * 1e3)
time_axes.set(xlabel="Time (s)", ylabel="Displacement (mm)", title="Chest displacement")
spectrum_axes.semilogy(spectrum.frequency, spectrum * 1e3)
spectrum_axes.set(xlim=(0, 2), ylim=(1e-3, 4), xlabel="Frequency (Hz)", ylabel="Amplitude (mm)")
spectrum_axes.set_title("Breath at 0.25 Hz, heartbeat at 1.2 Hz")
for name, band_hz in (("breath", (0.1, 0.6)), ("heartbeat", (0.9, 2.0))):
    line = dc.slow_time.strongest_oscillation(spectrum, band_hz)
    print(f"{name}: {line.frequency.item():.2f} Hz, {line.amplitude.item() * 1e3:.2f} mm")
