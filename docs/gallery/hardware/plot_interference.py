"""
A burst of another radar, and its repair
========================================

Where the ramp of another radar crosses that of this radar, its signal falls into the receiver
band for a moment. This burst raises the noise floor at all ranges (Brooker, IEEE T-EMC 49, 2007).
Linear prediction from both sides replaces the affected samples. The figure shows the burst in one
chirp, and the noise floor before and after the repair.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=100, range_resolution_m=0.5, max_velocity_m_per_s=20, rule="constraints"
).radar
other = dc.impairments.Interferer(
    start_frequency_hz=76.9e9,
    slope_hz_per_s=16e12,
    ramp_duration_s=18e-6,
    interval_s=23.3e-6,
    transmit_power_w=0.016,
    antenna_gain=20,
    position_m=(60, 5, 0),
)
scene = dc.Scene(targets=[dc.Target(position_m=(40, 0, 0), velocity_m_per_s=(6, 0, 0), rcs_m2=10)])
impairments = (dc.impairments.Interference(interferers=[other]), dc.impairments.ThermalNoise())
cube = dc.simulate(scene, radar, impairments=impairments, seed=1).isel(frame=0)

figure, (time_axes, profile_axes) = plt.subplots(1, 2)
chirp = cube.isel(chirp=10, rx=0)
time_axes.plot(chirp.sample * 1e6, chirp.real * 1e6)
time_axes.set(xlabel="Time since ramp start (µs)", ylabel="Beat signal, real part (√pW)")
time_axes.set_title("One chirp")
for name, repair in (("received", ()), ("repaired", (dc.mitigation.InterferenceAutoregression(),))):
    power = dc.power_map(cube, radar, dc.Chain(mitigation=repair))
    cut = power.sel(velocity=6, method="nearest")
    profile_axes.plot(cut.range, 10 * np.log10(cut) + 30, label=name)
    print(f"{name}: median of the map {10 * np.log10(power.median().item()) + 30:.1f} dBm")
profile_axes.set(xlabel="Range (m)", ylabel="Power at 6 m/s (dBm)", ylim=(-150, None))
profile_axes.set_title("A car at 40 m")
profile_axes.legend()
