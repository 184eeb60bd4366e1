r"""
Velocity ambiguity resolved by three chirp intervals
=====================================================

Chirps at an interval T tell velocities up to :math:`\lambda / 4T`; faster ones come back from
the other side. Frames of different intervals alias them differently, and only the true one agrees
with all (Kronauge and Rohling, IEEE T-AES 50, 2014). See the maps' velocities zigzag, and the
detections of the three frames together follow the truth.
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
one_s = radar.frame.single_interval_s
turns = dataclasses.replace(radar.frame, interval_s=(one_s, one_s * 9 / 8, one_s * 5 / 4))
in_turn = dataclasses.replace(radar, frame=dataclasses.replace(turns, period_s=10e-3))
speeds_m_per_s = np.linspace(-70, 70, 22)
alone, together = [], []
for number, speed in enumerate(speeds_m_per_s):
    target = dc.Target(position_m=(50, 0, 0), velocity_m_per_s=(speed, 0, 0), rcs_m2=300)
    scene = dc.Scene(targets=[target])
    first = dc.detect(dc.simulate(scene, radar, seed=number), radar)
    alone.append(first.velocity[0].item())
    three = dc.detect(dc.simulate(scene, in_turn, n_frames=3, seed=number), in_turn)
    together.append(three.velocity[0].item())

figure, axes = plt.subplots()
axes.plot(speeds_m_per_s, speeds_m_per_s, color="0.6", label="truth")
axes.plot(speeds_m_per_s, alone, "o", label="one interval")
axes.plot(speeds_m_per_s, together, "s", mfc="none", label="three intervals in turn")
axes.set(xlabel="Velocity of the target (m/s)", ylabel="Reported velocity (m/s)")
axes.set_title(
    f"Velocities aliased beyond {radar.frame.max_velocity_m_per_s:.0f} m/s, and resolved"
)
axes.legend()
print(f"largest error of three intervals: {np.abs(together - speeds_m_per_s).max():.3f} m/s")
