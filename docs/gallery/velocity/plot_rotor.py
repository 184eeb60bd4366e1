r"""
A rotor over time
=================

The tip of a blade of length :math:`l` that rotates at :math:`\Omega` reaches velocities of
:math:`\pm \Omega l` (Chen, The Micro-Doppler Effect in Radar, 2011): each scatterer on it traces
a sine. The figure shows two blades, half a turn apart, and the tip speeds as dotted lines.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=20, range_resolution_m=1, max_velocity_m_per_s=25, rule="constraints"
).radar
rate = 40.0  # rad/s, 6.4 turns a second
turn = dc.bodies.Rotation(center_m=(0, 0, 0), axis=(0, 0, 1), rate_rad_per_s=rate)
blades = [
    dc.bodies.Scatterer(position_m=(radius, 0, 0), rcs_m2=0.02, rotation=turn)
    for radius in (-0.4, -0.3, -0.2, 0.2, 0.3, 0.4)
]
hub = dc.bodies.Scatterer(position_m=(0, 0, 0), rcs_m2=0.1)
rotor = dc.Target(position_m=(8, 0, 0), body=dc.bodies.Points(scatterers=(hub, *blades)))
n_frames = round(0.3 / radar.frame.duration_s)
cube = dc.simulate(dc.Scene(targets=[rotor]), radar, n_frames=n_frames, seed=1)
power = dc.spectrogram(cube, radar, range_m=(6, 10), hop=32)

figure, axes = plt.subplots()
level_db = 10 * np.log10(power) + 30
level_db.plot(ax=axes, x="time", vmin=level_db.max() - 40, cbar_kwargs={"label": "Power (dBm)"})
for side in (-1, 1):
    axes.axhline(side * rate * 0.4, color="w", linestyle=":")
axes.set(xlabel="Time (s)", ylabel="Velocity (m/s, receding positive)")
axes.set_title(f"Two blades of 0.4 m at {rate:.0f} rad/s: tips at {rate * 0.4:.0f} m/s")
speed = abs(power.velocity.where(level_db.max("time") > level_db.max() - 25)).max().item()
print(f"fastest line {speed:.1f} m/s, tip speed {rate * 0.4:.1f} m/s")
