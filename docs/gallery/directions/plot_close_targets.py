"""
Two directions in one cell
==========================

The beam of eight elements is 12.8° wide, so beamforming merges two equal targets 9° apart at the
same range and velocity into one peak. Capon's method (Proceedings of the IEEE 57, 1969) and MUSIC
(Schmidt, IEEE T-AP 34, 1986) separate them. The figure shows the spectra of one detection, each
relative to its own peak; only the beamforming spectrum is a power.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

design_radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=20, rule="constraints"
).radar
array = dc.Array(rx_m=[(0, 1.94e-3 * element, 0) for element in range(8)])
radar = dataclasses.replace(design_radar, array=array)
azimuths_deg = (-4.5, 4.5)
targets = [
    dc.Target(position_m=(30 * np.cos(np.deg2rad(a)), 30 * np.sin(np.deg2rad(a)), 0), rcs_m2=10)
    for a in azimuths_deg
]
cube = dc.simulate(dc.Scene(targets=targets), radar, seed=1)

figure, axes = plt.subplots()
for estimator in (dc.angle.Fft(), dc.angle.Capon(n_sources=2), dc.angle.Music(n_sources=2)):
    chain = dc.Chain(angle=estimator)
    detections = dc.detect(cube, radar, chain)
    estimates_deg = np.rad2deg(np.unique(detections.azimuth))
    print(f"{type(estimator).kind():6} estimates {estimates_deg.round(2)} deg")
    spectrum = dc.angle_spectrum(cube.isel(frame=0), radar, detections, 0, chain).squeeze()
    level_db = 10 * np.log10(spectrum / spectrum.max())
    axes.plot(np.rad2deg(spectrum.azimuth), level_db, label=type(estimator).kind())
for azimuth in azimuths_deg:
    axes.axvline(azimuth, color="0.6", linestyle=":")
axes.set(xlim=(-40, 40), ylim=(-50, 2), xlabel="Azimuth (°, left positive)")
axes.set_ylabel("Spectrum relative to the peak (dB)")
axes.set_title("Two targets (dotted) 9° apart before eight elements")
axes.legend()
