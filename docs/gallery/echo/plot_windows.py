"""
Windows and range sidelobes
===========================

A pedestrian 5 m behind a truck, 30 dB weaker, lies below the sidelobes of the truck under a
rectangular window, which fall by only 6 dB per octave. Other windows lower the sidelobes and widen
the main lobe (Harris, Proceedings of the IEEE 66, 1978). The figure shows the pedestrian emerge,
without noise.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=100, range_resolution_m=0.5, max_velocity_m_per_s=30, rule="constraints"
).radar
truck = dc.Target(position_m=(40.2, 0, 0), rcs_m2=100)
pedestrian = dc.Target(position_m=(45.2, 0, 0), rcs_m2=0.16)
cube = dc.simulate(dc.Scene(targets=[truck, pedestrian]), radar, impairments=()).isel(frame=0)
expected_db = 10 * np.log10(0.16 / 100 * (40.2 / 45.2) ** 4)
print(f"pedestrian relative to truck: {expected_db:.1f} dB, by cross section and range")

figure, axes = plt.subplots()
for window in ("rectangular", "hann", "blackman-harris", "chebyshev-80"):
    chain = dc.Chain(range_window=window, n_range_bins=2048)
    profile = dc.power_map(cube, radar, chain).sel(velocity=0, method="nearest")
    level_db = 10 * np.log10(np.maximum(profile / profile.max(), 1e-12))
    axes.plot(profile.range, level_db, label=window)
    print(
        f"{window:16} {level_db.sel(range=45.2, method='nearest').item():6.1f} dB at the pedestrian"
    )
axes.axvline(45.2, color="0.6", linestyle=":")
axes.set(xlim=(33, 53), ylim=(-90, 3), xlabel="Range (m)", ylabel="Power relative to the peak (dB)")
axes.set_title("A pedestrian (dotted) behind a truck, under four windows")
axes.legend(loc="upper left")
