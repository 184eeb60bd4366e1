"""
Micro-Doppler of a pedestrian
=============================

Trunk, arms and legs move at different velocities; a short-time Fourier transform over slow time
shows them over time (Chen, The Micro-Doppler Effect in Radar, 2011). The figure shows the trunk as
a wavy line, and the feet swing forward in turn, almost four times as fast.
"""

import matplotlib.pyplot as plt

import dechirp as dc

radar = dc.design(
    max_range_m=15, range_resolution_m=0.3, max_velocity_m_per_s=6, rule="constraints"
).radar
walker = dc.Target(
    position_m=(6, 0, -0.8),
    velocity_m_per_s=(1.4, 0, 0),
    body=dc.bodies.Pedestrian(speed_m_per_s=1.4),
)
n_frames = round(1.6 / radar.frame.duration_s)
cube = dc.simulate(dc.Scene(targets=[walker]), radar, n_frames=n_frames, seed=1)
power = dc.spectrogram(cube, radar, range_m=(4, 10), hop=24)

figure, axes = plt.subplots()
power.dechirp.plot(axes)
figure.suptitle("A pedestrian walks away at 1.4 m/s")
strong = power.where(power > 20 * power.median(), 0)  # echoes, not noise
mean = (strong * power.velocity).sum() / strong.sum()
print(f"power-weighted mean velocity: {mean.item():.2f} m/s")
