r"""
Ego speed from static targets
=============================

Static targets approach at :math:`v \cos \phi`, so all of them lie on one curve (Kellner et al.,
IEEE ITSC 2013). The figure shows posts on both sides on the curve, and a moving car off it. The
fitted curve gives the ego speed.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

design_radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=22, rule="constraints"
).radar
array = dc.Array(rx_m=[(0, 1.94e-3 * element, 0) for element in range(8)])
radar = dataclasses.replace(design_radar, array=array)
posts = [
    dc.Target(name=f"post {x}", position_m=(x, y, 0), rcs_m2=10)
    for x, y in zip(range(6, 48, 2), 11 * [-6, 6], strict=False)
]
car = dc.Target(name="car", position_m=(25, 3, 0), velocity_m_per_s=(16, 0, 0), rcs_m2=10)
scene = dc.Scene(targets=[*posts, car], ego=dc.Ego(velocity_m_per_s=(20, 0, 0)))
detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
ego = dc.ego_motion(detections, radar)
speed = ego.vx.item()
is_static = abs(detections.velocity + speed * np.cos(detections.azimuth)) < 1

figure, axes = plt.subplots()
for label, is_member in (("static", is_static), ("moving", ~is_static)):
    group = detections.isel(detection=is_member)
    axes.plot(np.rad2deg(group.azimuth), group.velocity, "o", label=label)
azimuth = np.linspace(-60, 60, 121)
axes.plot(azimuth, -speed * np.cos(np.deg2rad(azimuth)), color="0.6", label="-v cos(azimuth)")
axes.set(xlabel="Azimuth (°, left positive)", ylabel="Velocity (m/s, receding positive)")
axes.set_title("Posts beside the road, and a car ahead, at 20 m/s")
axes.legend()
print(f"ego speed {speed:.4f} m/s, standard error {ego.vx_std.item():.4f} m/s, truth 20 m/s")
