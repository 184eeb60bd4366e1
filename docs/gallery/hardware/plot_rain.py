"""
Rain attenuation and backscatter
================================

Rain of 100 mm/h takes 31 dB of each kilometre at 77 GHz (ITU-R P.838-3), there and again on the
way back, and its drops send echoes of their own, which add to others or take from them. See equal
corner reflectors fall below those in clear air, and the ridge of drops before the radar.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=200,
    range_resolution_m=1,
    max_velocity_m_per_s=30,
    rule="constraints",
    hardware=dc.Hardware(transmit_power_w=0.02, antenna_gain=160, noise_factor=16),
).radar
places_m = (40, 80, 120, 160)
corners = [
    dc.Target(
        name=f"{at} m",
        position_m=(at, 0, 0),
        heading_rad=np.pi,
        body=dc.bodies.CornerReflector(edge_m=0.15),
    )
    for at in places_m
]
scene = dc.Scene(targets=corners)
rate = 0.1 / 3600  # m/s: 100 mm/h
weather = {
    "clear": (dc.impairments.ThermalNoise(),),
    "100 mm/h": (
        dc.impairments.ThermalNoise(),
        dc.impairments.RainBackscatter(rate_m_per_s=rate),
        dc.impairments.RainAttenuation(rate_m_per_s=rate),
    ),
}
figure, axes = plt.subplots()
peaks_db = {}
for name, impairments in weather.items():
    cube = dc.simulate(scene, radar, impairments=impairments, seed=1).isel(frame=0)
    power = dc.power_map(cube, radar, dc.Chain()).sel(velocity=slice(-10, 10)).max("velocity")
    axes.plot(power.range, 10 * np.log10(power) + 30, label=name)
    peaks_db[name] = [
        10 * np.log10(power.sel(range=slice(at - 3, at + 3)).max().item()) for at in places_m
    ]
axes.set(xlim=(0, 200), xlabel="Range (m)", ylabel="Largest power from -10 to 10 m/s (dBm)")
axes.set_title("Four corner reflectors, in clear air and in a cloudburst")
axes.legend()
lost_db = np.subtract(peaks_db["clear"], peaks_db["100 mm/h"])
first, rain = dc.Scene(targets=corners[:1]), (dc.impairments.RainAttenuation(rate_m_per_s=rate),)
heard = [abs(dc.simulate(first, radar, impairments=of, seed=1)).mean().item() for of in ((), rain)]
taken_db_per_km = 20 * np.log10(heard[0] / heard[1]) / (2 * places_m[0] / 1000)
print(f"Rain alone takes {taken_db_per_km:.1f} dB of each kilometre")
for at, lost in zip(places_m, lost_db, strict=True):
    print(f"{at:3} m: {lost:4.1f} dB less, by that {2 * at / 1000 * taken_db_per_km:4.1f} dB")
