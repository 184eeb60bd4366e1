"""
Doppler-division multiplexing of three transmitters
===================================================

Doppler-division multiplexing shifts the phase of each transmitter from chirp to chirp, so that
each echo appears once per transmitter, one sub-band apart (Jansen, European Radar Conference
2019). An empty sub-band identifies the first line. The figure shows three lines of one target,
and the gap.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

design_radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=40, rule="constraints"
).radar
array = dc.Array(
    tx_m=[(0, 7.76e-3 * element, 0) for element in range(3)],
    rx_m=[(0, 1.94e-3 * element, 0) for element in range(4)],
)
code = dc.multiplexing.Ddma(order=(0, 1, 2), n_sub_bands=4)
frame = dataclasses.replace(
    design_radar.frame, n_chirps=design_radar.frame.n_chirps // 4, multiplexing=code
)
radar = dataclasses.replace(design_radar, frame=frame, array=array)
target = dc.Target(position_m=(30, 5, 0), velocity_m_per_s=(6, 1, 0), rcs_m2=10)
scene = dc.Scene(targets=[target])
cube = dc.simulate(scene, radar, seed=1)

samples = cube.isel(frame=0, rx=0)
taper = np.outer(np.hanning(samples.sizes["chirp"]), np.hanning(samples.sizes["sample"]))
spectrum = np.fft.fftshift(np.fft.fft2(samples * taper / taper.sum()), axes=0)
line = spectrum[:, round(30.4 / radar.frame.chirp.range_resolution_m)]
doppler_khz = np.fft.fftshift(np.fft.fftfreq(len(line), radar.frame.single_interval_s)) / 1e3

figure, axes = plt.subplots()
axes.plot(doppler_khz, 20 * np.log10(abs(line)) + 30)
axes.set(xlabel="Doppler frequency (kHz)", ylabel="Power (dBm)", ylim=(-145, -92))
target_khz = 2 * dc.truth(scene, radar).velocity.item() / radar.frame.chirp.wavelength_m / 1e3
span_khz = 1e-3 / radar.frame.single_interval_s
for slot, sender in enumerate(("transmitter 0", "transmitter 1", "transmitter 2", "empty")):
    line_khz = (target_khz + slot / 4 * span_khz + span_khz / 2) % span_khz - span_khz / 2
    axes.text(line_khz, -95, sender, ha="center", size="small")
axes.set_title("One target, three transmitters in four sub-bands")
peak_khz = doppler_khz[abs(doppler_khz - target_khz) < span_khz / 8]
peak = peak_khz[abs(line[np.isin(doppler_khz, peak_khz)]).argmax()]
print(f"line of transmitter 0 at {peak:.1f} kHz; 2 v / lambda: {target_khz:.1f} kHz")
