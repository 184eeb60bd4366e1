"""
Range-Doppler coupling
======================

The Doppler frequency adds to that of the beat: on a rising ramp a receding target seems :math:`v
f / S` too far (Griffiths, Electronics and Communication Engineering Journal 2, 1990). See the
peak of the map move with velocity, and detections, which know it, stay at the truth.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=150, range_resolution_m=0.8, max_velocity_m_per_s=50, rule="constraints"
).radar
chain = dc.Chain(n_range_bins=8192)
speeds_m_per_s = np.linspace(-45, 45, 13)
seen_m, told_m = [], []
for number, speed in enumerate(speeds_m_per_s):
    target = dc.Target(position_m=(60, 0, 0), velocity_m_per_s=(speed, 0, 0), rcs_m2=100)
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, seed=number)
    truth_m = dc.truth(scene, radar).range.item()
    power = dc.power_map(cube.isel(frame=0), radar, chain)
    seen_m.append(power.max("velocity").idxmax("range").item() - truth_m)
    told_m.append(dc.detect(cube, radar).range[0].item() - truth_m)

coupling_m = [radar.frame.chirp.range_doppler_coupling_m(speed) for speed in speeds_m_per_s]
figure, axes = plt.subplots()
axes.plot(speeds_m_per_s, coupling_m, "-", color="0.6", label="v f / S")
axes.plot(speeds_m_per_s, seen_m, "o", label="peak of the map")
axes.plot(speeds_m_per_s, told_m, "s", label="detection")
axes.set(xlabel="Velocity (m/s, receding positive)", ylabel="Range error (m)")
axes.set_title("Range error of a receding target without correction")
axes.legend()
print(f"largest error: map {np.abs(seen_m).max():.3f} m, detections {np.abs(told_m).max():.3f} m")
