"""
Zero padding interpolates, it does not resolve
==============================================

Two equal targets 0.7 resolution cells :math:`c / 2B` apart remain one peak, however finely the
spectrum is sampled; twice the bandwidth separates them. (The depth of the dip also depends on the
phase between the echoes.) The figure shows one peak on the left, with 134 as with 4096 bins, and
two on the right.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=10, rule="constraints"
).radar
wide = dataclasses.replace(
    radar.frame.chirp, slope_hz_per_s=2 * radar.frame.chirp.slope_hz_per_s
)  # the same samples of a ramp twice as steep
wider = dataclasses.replace(radar, frame=dataclasses.replace(radar.frame, chirp=wide))
ranges_m = (20.0, 20.35)
scene = dc.Scene(
    targets=[dc.Target(position_m=(distance, 0, 0), rcs_m2=10) for distance in ranges_m]
)

figure, columns = plt.subplots(1, 2, sharey=True)
for axes, design in zip(columns, (radar, wider), strict=True):
    cube = dc.simulate(scene, design, seed=1).isel(frame=0)
    for n_bins, style in ((design.frame.chirp.n_samples, "o"), (4096, "-")):
        chain = dc.Chain(range_window="rectangular", n_range_bins=n_bins)
        profile = dc.power_map(cube, design, chain).sel(velocity=0, method="nearest")
        near = profile.sel(range=slice(18, 22.5))
        axes.plot(near.range, 10 * np.log10(near) + 30, style, label=f"{n_bins} bins")
    for distance in ranges_m:
        axes.axvline(distance, color="0.6", linestyle=":")
    axes.set(xlabel="Range (m)", ylabel="Power (dBm)", ylim=(-130, None))
    axes.set_title(f"cells of {design.frame.chirp.range_resolution_m:.2f} m")
    axes.legend()
figure.suptitle("Targets (dotted) 0.35 m apart")
