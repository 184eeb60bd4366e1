"""
Two-way antenna pattern
=======================

The antenna pattern acts on an echo twice, on transmission and on reception: where one gain is 3 dB
down, the echo is 6 dB down (Richards, Fundamentals of Radar Signal Processing, 2.2). Detections of
equal targets, normalised by :math:`R^4`, lie on the product of both gains. The figure shows the
echo over azimuth.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

beam = dc.patterns.Cosine(
    azimuth_beamwidth_rad=np.deg2rad(50), elevation_beamwidth_rad=np.deg2rad(20), gain=20
)
design_radar = dc.design(
    max_range_m=60,
    range_resolution_m=0.5,
    max_velocity_m_per_s=20,
    rule="constraints",
    hardware=dc.Hardware(transmit_power_w=0.02, tx_pattern=beam, rx_pattern=beam, noise_factor=10),
).radar
array = dc.Array(rx_m=[(0, 1.94e-3 * element, 0) for element in range(8)])
radar = dataclasses.replace(design_radar, array=array)
azimuths = np.deg2rad(np.arange(-50, 51, 10))
targets = [
    dc.Target(position_m=(distance * np.cos(azimuth), distance * np.sin(azimuth), 0), rcs_m2=40)
    for distance, azimuth in zip(range(20, 42, 2), azimuths, strict=True)
]
scene = dc.Scene(targets=targets)
truth = dc.truth(scene, radar).isel(frame=0)
detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)

boresight_level = (truth.snr * truth.range**4).max().item()
grid = np.linspace(-1, 1, 201)
two_way_gain = radar.hardware.tx_gain(grid) * radar.hardware.rx_gain(grid) / beam.peak_gain**2
figure, axes = plt.subplots()
axes.plot(np.rad2deg(grid), 10 * np.log10(two_way_gain), color="0.6", label="product of both gains")
relative_level = detections.snr * detections.range**4 / boresight_level
axes.plot(np.rad2deg(detections.azimuth), 10 * np.log10(relative_level), "o", label="detections")
axes.axvspan(-25, 25, color="0.95")
axes.set(xlabel="Azimuth (°, left positive)", ylabel="Echo relative to boresight (dB)")
axes.set(ylim=(-30, 2))
axes.set_title("A beam of 50° (grey): echoes at its edges are 6 dB down")
axes.legend()
print(f"{detections.sizes['detection']} of {len(targets)} targets detected")
