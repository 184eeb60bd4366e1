r"""
The image of an I/Q imbalance
=============================

A gain error g or phase error between I and Q creates an image of each tone at the negative
frequency, weaker by :math:`(1 + 2 g \cos \phi + g^2) / (1 - 2 g \cos \phi + g^2)` (Razavi, RF
Microelectronics, 2011). On the map it lies at the far end of the range axis, with the opposite
velocity. The figure shows target and image.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=20, rule="constraints"
).radar
target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(10, 0, 0), rcs_m2=100)
imbalance = dc.impairments.IqImbalance(gain=10**0.05, phase_rad=np.deg2rad(3))
cube = dc.simulate(
    dc.Scene(targets=[target]),
    radar,
    impairments=(dc.impairments.ThermalNoise(), imbalance),
    seed=1,
)
power = dc.power_map(cube.isel(frame=0), radar, dc.Chain())

g, cosine = np.sqrt(imbalance.gain), np.cos(imbalance.phase_rad)
theory_db = 10 * np.log10((1 + 2 * g * cosine + g**2) / (1 - 2 * g * cosine + g**2))
target_region, image_region = power.sel(velocity=slice(5, 15)), power.sel(velocity=slice(-15, -5))
ratio_db = 10 * np.log10(target_region.max().item() / image_region.max().item())
print(f"image {ratio_db:.1f} dB below the target, theory {theory_db:.1f} dB")

figure, axes = plt.subplots()
level_db = 10 * np.log10(power) + 30
level_db.plot(ax=axes, x="velocity", vmin=-140, cbar_kwargs={"label": "Power (dBm)"})
axes.set(xlabel="Velocity (m/s, receding positive)", ylabel="Range (m)")
axes.set_title("A target at 20 m and 10 m/s, and its image at -10 m/s")
