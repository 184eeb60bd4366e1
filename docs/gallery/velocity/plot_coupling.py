"""
Range-Doppler coupling
======================

The Doppler frequency adds to the beat frequency: on a rising ramp a receding target appears
:math:`v f / S` too far away (Griffiths, Electronics and Communication Engineering Journal 2,
1990). The figure shows the peak of the map shift with velocity, and detections, which correct for
it, at the true range.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=150, range_resolution_m=0.8, max_velocity_m_per_s=50, rule="constraints"
).radar
chain = dc.Chain(n_range_bins=8192)
speeds_m_per_s = np.linspace(-45, 45, 13)
map_errors_m, detection_errors_m = [], []
for number, speed in enumerate(speeds_m_per_s):
    target = dc.Target(position_m=(60, 0, 0), velocity_m_per_s=(speed, 0, 0), rcs_m2=100)
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, seed=number)
    truth_m = dc.truth(scene, radar).range.item()
    power = dc.power_map(cube.isel(frame=0), radar, chain)
    map_errors_m.append(power.max("velocity").idxmax("range").item() - truth_m)
    detection_errors_m.append(dc.detect(cube, radar).range[0].item() - truth_m)

coupling_m = [radar.frame.chirp.range_doppler_coupling_m(speed) for speed in speeds_m_per_s]
figure, axes = plt.subplots()
axes.plot(speeds_m_per_s, coupling_m, "-", color="0.6", label="v f / S")
axes.plot(speeds_m_per_s, map_errors_m, "o", label="peak of the map")
axes.plot(speeds_m_per_s, detection_errors_m, "s", label="detection")
axes.set(xlabel="Velocity (m/s, receding positive)", ylabel="Range error (m)")
axes.set_title("Range error over velocity, with and without correction")
axes.legend()
print(f"largest error of the map: {np.abs(map_errors_m).max():.3f} m")
print(f"largest error of detections: {np.abs(detection_errors_m).max():.3f} m")
