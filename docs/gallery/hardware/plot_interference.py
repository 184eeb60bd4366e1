"""
A burst of another radar, and its repair
========================================

Where the ramp of another radar crosses ours its signal falls into our band for a moment: a burst,
which raises the floor at all ranges (Brooker, IEEE T-EMC 49, 2007). Samples in it are filled from
both sides by linear prediction. See the burst in one chirp, and the floor before and after.
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

figure, (left, right) = plt.subplots(1, 2)
one = cube.isel(chirp=10, rx=0)
left.plot(one.sample * 1e6, one.real * 1e6)
left.set(xlabel="Time since ramp start (µs)", ylabel="Beat signal, I (sqrt(pW))")
left.set_title("One chirp")
for name, repair in (("received", ()), ("repaired", (dc.mitigation.InterferenceAutoregression(),))):
    power = dc.power_map(cube, radar, dc.Chain(mitigation=repair))
    cut = power.sel(velocity=6, method="nearest")
    right.plot(cut.range, 10 * np.log10(cut) + 30, label=name)
    print(f"{name}: median of the map {10 * np.log10(power.median().item()) + 30:.1f} dBm")
right.set(xlabel="Range (m)", ylabel="Power at 6 m/s (dBm)", ylim=(-150, None))
right.set_title("A car at 40 m")
right.legend()
