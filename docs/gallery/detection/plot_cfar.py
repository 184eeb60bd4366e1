"""
Four detectors at the edge of clutter
=====================================

A CFAR threshold follows the noise level of the training cells. A strong neighbour raises the
threshold of cell averaging and masks the weak target behind it; at a clutter edge the threshold
rises too late. Methods based on window halves or ranks correct one of these errors or the other
(Gandhi and Kassam, IEEE T-AES 24, 1988). The figure shows which thresholds stay below the weak
target, and which are exceeded at the clutter edge.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=150, range_resolution_m=0.8, max_velocity_m_per_s=20, rule="constraints"
).radar
clutter = dc.bodies.GroundClutter(near_m=90, far_m=130, width_m=60, n_patches=3000, gamma=10)
scene = dc.Scene(
    targets=[
        dc.Target(name="strong", position_m=(40, 0, 0), rcs_m2=60),
        dc.Target(name="weak", position_m=(44.8, 0, 0), rcs_m2=1.5),
        dc.Target(name="clutter", position_m=(0, 0, -0.5), body=clutter),
    ]
)
plain = dc.Chain(range_window="rectangular", doppler_window="rectangular")
power = dc.power_map(dc.simulate(scene, radar, seed=1).isel(frame=0), radar, plain)

figure, axes = plt.subplots()
cut = power.sel(velocity=0, method="nearest")
axes.plot(cut.range, 10 * np.log10(cut) + 30, color="0.7", label="power at zero velocity")
for estimator in (
    dc.cfar.CellAveraging(),
    dc.cfar.GreatestOf(),
    dc.cfar.SmallestOf(),
    dc.cfar.OrderedStatistic(),
):
    cfar = dc.Cfar(
        estimator=estimator,
        n_training=dc.Cells(range=12, velocity=0),
        n_guard=dc.Cells(range=2, velocity=0),
        false_alarm_probability=1e-4,
    )
    chain = dataclasses.replace(plain, cfar=cfar)
    threshold = dc.threshold_map(power, radar, chain).sel(velocity=0, method="nearest")
    axes.plot(cut.range, 10 * np.log10(threshold) + 30, label=type(estimator).kind())
    is_above = (cut > threshold).sel(range=slice(44, 46)).any().item()
    print(f"{type(estimator).kind():18} finds the weak target: {is_above}")
axes.set(xlim=(15, 135), xlabel="Range (m)", ylabel="Power (dBm)", ylim=(-140, None))
axes.set_title("Thresholds for 1e-4: a weak target at 45 m, clutter from 90 m")
axes.legend(loc="upper right", fontsize="small")
