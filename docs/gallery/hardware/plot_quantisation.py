"""
The noise floor of a converter
==============================

Quantisation noise of b bits is :math:`6.02 b + 1.76` dB below a full-scale tone (Bennett, Bell
System Technical Journal 27, 1948); two transforms spread it over all cells. The figure shows the
floor, which falls with the number of bits until receiver noise dominates. At 4 and 6 bits the noise
is far below one step, and rounding gives spectral lines instead of a floor.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=100, range_resolution_m=0.5, max_velocity_m_per_s=20, rule="constraints"
).radar
scene = dc.Scene(targets=[dc.Target(position_m=(10, 0, 0), velocity_m_per_s=(3, 0, 0), rcs_m2=1e4)])
full_scale_w = 1e-3 * 10**-4.4  # -44 dBm
# Noise of one cell relative to the sum over samples, with Hann windows.
cell_share = 1.5**2 / (radar.frame.chirp.n_samples * radar.frame.n_chirps)

figure, axes = plt.subplots()
for bits in (4, 6, 8, 12):
    converter = dc.impairments.Quantisation(bits=bits, full_scale_w=full_scale_w)
    cube = dc.simulate(scene, radar, impairments=(dc.impairments.ThermalNoise(), converter), seed=1)
    power = dc.power_map(cube.isel(frame=0), radar, dc.Chain()).mean("velocity")
    axes.plot(power.range, 10 * np.log10(power) + 30, label=f"{bits} bits")
    floor_dbm = 10 * np.log10(power.sel(range=slice(30, 90)).mean().item()) + 30
    alone_dbm = 10 * np.log10(full_scale_w / (1.5 * 4**bits) * cell_share) + 30
    print(
        f"{bits:2} bits: floor {floor_dbm:.1f} dBm, predicted for the converter {alone_dbm:.1f} dBm"
    )
axes.set(xlabel="Range (m)", ylabel="Power, mean over velocity (dBm)")
axes.set_title("A strong target at 10 m, 6 dB below full scale")
axes.legend()
