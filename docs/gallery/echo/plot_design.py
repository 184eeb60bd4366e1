"""
Feasible radar designs
======================

Fine range resolution requires bandwidth, fast targets require short chirp intervals, and distant
targets give high beat frequencies: :math:`f_b = 2 S R / c` with :math:`S = B / T`. The figure
shows the resulting sample rate for a maximum range of 150 m. Crosses mark infeasible designs, for
which `dc.design` reports the requirement that is not met, and the reason.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

resolutions_m = np.geomspace(0.15, 3, 16)
speeds_m_per_s = np.geomspace(10, 100, 14)
rate_mhz = np.empty((len(speeds_m_per_s), len(resolutions_m)))
is_met = np.empty_like(rate_mhz, dtype=bool)
for row, speed in enumerate(speeds_m_per_s):
    for column, resolution in enumerate(resolutions_m):
        result = dc.design(
            max_range_m=150,
            range_resolution_m=resolution,
            max_velocity_m_per_s=speed,
            rule="constraints",
        )
        rate_mhz[row, column] = result.radar.frame.chirp.sample_rate_hz / 1e6
        is_met[row, column] = result.is_met

figure, axes = plt.subplots()
axes.grid(False)
image = axes.pcolormesh(resolutions_m, speeds_m_per_s, np.where(is_met, rate_mhz, np.nan))
unmet = np.argwhere(~is_met)
axes.plot(resolutions_m[unmet[:, 1]], speeds_m_per_s[unmet[:, 0]], "x", color="0.6", ms=5)
axes.set(xscale="log", yscale="log", xlabel="Range resolution (m)", ylabel="Maximum velocity (m/s)")
axes.set_xticks([0.2, 0.5, 1, 2], ["0.2", "0.5", "1", "2"])
axes.set_yticks([10, 20, 50, 100], ["10", "20", "50", "100"])
axes.minorticks_off()
axes.set_title("Sample rate of a radar to 150 m; crossed: infeasible")
figure.colorbar(image, label="Sample rate (MHz)")
print(f"{is_met.sum()} of {is_met.size} designs meet all requirements")
