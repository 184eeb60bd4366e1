"""
The range-Doppler map of a road
===============================

Two Fourier transforms, over fast time and slow time, separate echoes by range and velocity
(Winkler, European Radar Conference 2007). The figure shows receding targets above zero velocity,
approaching ones below it, wheels spread over velocity, and the posts of a guard rail, whose
velocity is the ego speed times the cosine of their azimuth.
"""

import matplotlib.pyplot as plt

import dechirp as dc

radar = dc.design(
    max_range_m=110,
    range_resolution_m=0.8,
    max_velocity_m_per_s=50,
    rule="constraints",
    hardware=dc.Hardware(transmit_power_w=0.02, antenna_gain=100, noise_factor=10),
).radar
car, truck = dc.bodies.Car(speed_m_per_s=33), dc.bodies.Truck(speed_m_per_s=22)
scene = dc.Scene(
    ego=dc.Ego(velocity_m_per_s=(25, 0, 0)),
    targets=[
        dc.Target(position_m=(45, 3.5, -0.5), velocity_m_per_s=(33, 0, 0), body=car),
        dc.Target(position_m=(70, -3.5, -0.5), velocity_m_per_s=(22, 0, 0), body=truck),
        dc.Target(position_m=(100, 9, -0.5), velocity_m_per_s=(-20, 0, 0), body=dc.bodies.Van()),
        dc.Target(
            position_m=(50, -7, -0.5), body=dc.bodies.GuardRail(length_m=80, post_spacing_m=4)
        ),
    ],
)
cube = dc.simulate(scene, radar, seed=1).isel(frame=0)
power = dc.power_map(cube, radar, dc.Chain())

figure, axes = plt.subplots()
power.dechirp.plot(axes)
figure.suptitle("Car and truck ahead, oncoming van, guard rail")
rail = power.sel(range=31, method="nearest").idxmax("velocity").item()
print(f"strongest at 31 m: {rail:.1f} m/s; predicted {-25 * (1 - (7 / 31) ** 2) ** 0.5:.1f} m/s")
