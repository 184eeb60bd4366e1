"""
Ghost targets from a guard rail
===============================

A guard rail acts as a mirror: echoes also arrive via the rail, on one leg of the path or on both
(Kamann et al., IEEE Access 6, 2018). With one reflection, the range is the mean of the direct and
the mirrored path. The figure shows the car and two ghosts behind it at the predicted ranges.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=40, range_resolution_m=0.2, max_velocity_m_per_s=12, rule="constraints"
).radar
rail = dc.impairments.WallMultipath(start_m=(-20, 3), end_m=(100, 3), reflectivity=0.8)
car = dc.Target(position_m=(14, -2.5, 0), velocity_m_per_s=(4, 0, 0), rcs_m2=5)
cube = dc.simulate(
    dc.Scene(targets=[car]), radar, impairments=(rail, dc.impairments.ThermalNoise()), seed=1
)
power = dc.power_map(cube.isel(frame=0), radar, dc.Chain(n_range_bins=1024))

mid_x_m = 14 + 4 * radar.frame.mid_frame_s
straight_m, mirrored_m = np.hypot(mid_x_m, 2.5), np.hypot(mid_x_m, 2 * 3 + 2.5)
path_ranges_m = {
    "car": straight_m,
    "one reflection": (straight_m + mirrored_m) / 2,
    "two reflections": mirrored_m,
}
detections = dc.detect(cube, radar)
print("predicted:", np.round(list(path_ranges_m.values()), 2), "m")
print("detected: ", np.sort(detections.range).round(2), "m")

figure, axes = plt.subplots()
level_db = 10 * np.log10(power) + 30
level_db.plot(ax=axes, x="velocity", vmin=-140, cbar_kwargs={"label": "Power (dBm)"})
for name, range_m in path_ranges_m.items():
    axes.text(6, range_m, name, color="w", va="center")
axes.set(xlabel="Velocity (m/s, receding positive)", ylabel="Range (m)")
axes.set(xlim=(-2, 10), ylim=(12, 19))
axes.set_title("One car beside a rail, three propagation paths")
