r"""
Virtual array of a TDM radar
============================

The echo from transmitter p to receiver q has the phase of a virtual element at the sum of their
positions, p + q (Bliss and Forsythe, Asilomar Conference 2003). With time-division multiplexing,
the phase of a moving target also advances by :math:`4 \pi v T_c / \lambda` from one transmitter to
the next (Bechter et al., IEEE T-MTT 65, 2017). The figure shows phase steps at each change of
transmitter, and a straight line after motion compensation.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

half_m = 1.94e-3  # half a wavelength
array = dc.Array(
    tx_m=[(0, 4 * half_m * element, 0) for element in range(3)],
    rx_m=[(0, half_m * element, 0) for element in range(4)],
)
design_radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=40, rule="constraints"
).radar
frame = dataclasses.replace(design_radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2)))
radar = dataclasses.replace(design_radar, frame=frame, array=array)
azimuth, speed = np.deg2rad(20), 8.0
direction = np.array([np.cos(azimuth), np.sin(azimuth), 0])
target = dc.Target(
    position_m=tuple(30 * direction), velocity_m_per_s=tuple(speed * direction), rcs_m2=10
)
cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=()).isel(frame=0)

row = round(30 / radar.frame.chirp.range_resolution_m)
received = np.fft.fft(cube, axis=cube.get_axis_num("sample"))[
    :3, :, row
]  # the first round, (tx, rx)
phase_step = 4 * np.pi * speed * radar.frame.single_interval_s / radar.frame.chirp.wavelength_m
compensated = received * np.exp(-1j * phase_step * np.arange(3))[:, None]
y_m = radar.array.virtual_positions_m[:, 1]
expected = -2 * np.pi * y_m * np.sin(azimuth) / radar.frame.chirp.wavelength_m

figure, axes = plt.subplots()
for values, mark, label in ((received, "o", "received"), (compensated, "s", "compensated")):
    phase = np.unwrap(np.angle(values.ravel()))
    axes.plot(y_m * 1e3, np.rad2deg(phase - phase[0]), mark, label=label)
axes.plot(y_m * 1e3, np.rad2deg(expected), color="0.6", label="wave from 20°")
for edge in (7, 15):
    axes.axvline(edge * half_m * 1e3 / 2, color="0.8", linestyle=":")
axes.set(xlabel="Virtual element position (mm)", ylabel="Phase relative to first element (°)")
axes.set_title("Three transmitters with TDM, four receivers, without noise")
axes.legend()
error_deg = np.rad2deg(np.abs(phase - phase[0] - expected).max())
print(f"phase step per transmitter: {np.rad2deg(phase_step):.1f} deg")
print(f"largest error after compensation: {error_deg:.1f} deg")
