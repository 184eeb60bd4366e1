"""
Tracks of a car that overtakes a truck
======================================

A Kalman filter joins the detections of successive frames to tracks (Bar-Shalom et al., Estimation
with Applications to Tracking and Navigation, 2001). The figure shows detections (dots) and two
tracks from above over three seconds, and the estimated velocities with the true ones (dotted).
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

design_radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=20, rule="constraints"
).radar
array = dc.Array(rx_m=[(0, 1.94e-3 * element, 0) for element in range(4)])
frame = dataclasses.replace(design_radar.frame, period_s=0.1)
radar = dataclasses.replace(design_radar, array=array, frame=frame)
scene = dc.Scene(
    targets=[
        dc.Target(name="car", position_m=(20, 3.5, 0), velocity_m_per_s=(12, 0, 0), rcs_m2=20),
        dc.Target(name="truck", position_m=(40, -0.5, 0), velocity_m_per_s=(3, 0, 0), rcs_m2=50),
    ]
)
scenario = dc.Scenario(
    radar=radar, scene=scene, n_frames=30, seed=1, tracker=dc.Tracker(target_size_m=0.3)
)
result = dc.run(scenario)
detections, tracks = result.detections, result.tracks

figure, (position_axes, velocity_axes) = plt.subplots(1, 2)
y_m, x_m = (
    detections.range * np.sin(detections.azimuth),
    detections.range * np.cos(detections.azimuth),
)
position_axes.plot(y_m, x_m, ".", color="0.7")
for number in tracks.track.values:
    track = tracks.sel(track=number)
    position_axes.plot(track.y, track.x, label=f"track {number}")
    velocity_axes.plot(result.times_s, track.vx)
    print(f"track {number}: {track.vx[-1].item():.2f} m/s, {track.vy[-1].item():+.2f} m/s across")
for speed in (12, 3):
    velocity_axes.axhline(speed, color="0.6", linestyle=":")
position_axes.set(xlabel="y (m, left positive)", ylabel="x (m, forward)", xlim=(12, -12))
velocity_axes.set(xlabel="Time (s)", ylabel="Velocity along x (m/s)")
position_axes.legend()
figure.suptitle("A car at 12 m/s overtakes a truck at 3 m/s")
