r"""
Velocity ambiguity resolved by three chirp intervals
====================================================

Chirps at an interval :math:`T_c` measure velocities up to :math:`\lambda / 4 T_c`; faster targets
are aliased. Frames of different intervals alias them differently, and only the true velocity agrees
with all (Kronauge and Rohling, IEEE T-AES 50, 2014). The figure shows the aliased velocities of one
interval, and detections from three frames that follow the truth.
"""

import dataclasses
import warnings

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

warnings.simplefilter("ignore", dc.PhysicsWarning)  # aliased targets are intended
radar = dc.design(
    max_range_m=100, range_resolution_m=1, max_velocity_m_per_s=20, rule="constraints"
).radar
interval_s = radar.frame.single_interval_s
turns = dataclasses.replace(
    radar.frame, interval_s=(interval_s, interval_s * 9 / 8, interval_s * 5 / 4)
)
in_turn = dataclasses.replace(radar, frame=dataclasses.replace(turns, period_s=10e-3))
speeds_m_per_s = np.linspace(-70, 70, 22)
single_interval, three_intervals = [], []
for number, speed in enumerate(speeds_m_per_s):
    target = dc.Target(position_m=(50, 0, 0), velocity_m_per_s=(speed, 0, 0), rcs_m2=300)
    scene = dc.Scene(targets=[target])
    first = dc.detect(dc.simulate(scene, radar, seed=number), radar)
    single_interval.append(first.velocity[0].item())
    three = dc.detect(dc.simulate(scene, in_turn, n_frames=3, seed=number), in_turn)
    three_intervals.append(three.velocity[0].item())

figure, axes = plt.subplots()
axes.plot(speeds_m_per_s, speeds_m_per_s, color="0.6", label="truth")
axes.plot(speeds_m_per_s, single_interval, "o", label="one interval")
axes.plot(speeds_m_per_s, three_intervals, "s", mfc="none", label="three intervals in turn")
axes.set(xlabel="Velocity of the target (m/s)", ylabel="Reported velocity (m/s)")
axes.set_title(
    f"Velocities aliased beyond {radar.frame.max_velocity_m_per_s:.0f} m/s, and resolved"
)
axes.legend()
print(f"largest error of three intervals: {np.abs(three_intervals - speeds_m_per_s).max():.3f} m/s")
