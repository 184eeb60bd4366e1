r"""
Range and azimuth of a parking lot
==================================

Beamforming in each range cell maps the surroundings. The beam of twelve elements is
:math:`0.886 \lambda / L \cos \phi` wide, 8.5° ahead and wider to the sides (Van Trees, Optimum
Array Processing, 2002). The figure shows three parked cars (true outlines dotted), the posts of a
rail to the left, and the sidelobes of the strongest echoes as arcs.
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

design_radar = dc.design(
    max_range_m=30, range_resolution_m=0.2, max_velocity_m_per_s=8, rule="constraints"
).radar
array = dc.Array(rx_m=[(0, 1.94e-3 * element, 0) for element in range(12)])
radar = dataclasses.replace(design_radar, array=array)
car_positions_m = ((9, -4), (16, -4), (20, 3))  # headings along the x axis
cars = [
    dc.Target(position_m=(x, y, -0.5), heading_rad=0.0, body=dc.bodies.Car())
    for x, y in car_positions_m
]
rail = dc.Target(position_m=(14, 7, -0.5), body=dc.bodies.GuardRail(length_m=20, post_spacing_m=2))
cube = dc.simulate(dc.Scene(targets=[*cars, rail]), radar, seed=1)
power = dc.range_azimuth_map(cube.isel(frame=0), radar)

figure, axes = plt.subplots(figsize=(7.2, 4.6))
axes.grid(False)
x, y = np.cos(power.azimuth) * power.range, np.sin(power.azimuth) * power.range
image = axes.pcolormesh(y, x, 10 * np.log10(power) + 30, vmin=-120, shading="gouraud")
for x_car, y_car in car_positions_m:
    corners = ((-2.5, -1), (-2.5, 1), (2.5, 1), (2.5, -1), (-2.5, -1))
    axes.plot(*np.array([(y_car + b, x_car + a) for a, b in corners]).T, "w:")
axes.set(xlim=(15, -15), ylim=(0, 25), aspect="equal")
axes.set(xlabel="y (m, left positive)", ylabel="x (m, forward)")
axes.set_title("Three parked cars and a rail, top view")
figure.colorbar(image, label="Power in one element (dBm)")
