"""
Ghosts off a guard rail
=======================

A rail is a mirror: echoes also come by way of it, one way or both (Kamann et al., IEEE Access 6,
2018). One way off it, the range is the mean of the straight and the mirrored way. See the car
once and two ghosts behind it, where the image behind the rail has them.
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

middle = 14 + 4 * radar.frame.mid_frame_s
straight_m, mirrored_m = np.hypot(middle, 2.5), np.hypot(middle, 2 * 3 + 2.5)
path_ranges_m = {
    "car": straight_m,
    "one way": (straight_m + mirrored_m) / 2,
    "both ways": mirrored_m,
}
detections = dc.detect(cube, radar)
print("expected at", np.round(list(path_ranges_m.values()), 2), "m")
print("found at   ", np.sort(detections.range).round(2), "m")

figure, axes = plt.subplots()
level_db = 10 * np.log10(power) + 30
level_db.plot(ax=axes, x="velocity", vmin=-140, cbar_kwargs={"label": "Power (dBm)"})
for name, at_m in path_ranges_m.items():
    axes.text(6, at_m, name, color="w", va="center")
axes.set(xlabel="Velocity (m/s, receding positive)", ylabel="Range (m)")
axes.set(xlim=(-2, 10), ylim=(12, 19))
axes.set_title("One car beside a rail, by three ways")
