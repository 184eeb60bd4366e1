"""
Rain attenuation and backscatter
================================

Rain of 100 mm/h attenuates a 77 GHz signal by 31 dB per kilometre and direction (ITU-R P.838-3),
and the echoes of its drops interfere with those of targets. The figure shows equal corner
reflectors in rain and in clear air, and the backscatter of the drops at short range.
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
ranges_m = (40, 80, 120, 160)
corners = [
    dc.Target(
        name=f"{distance} m",
        position_m=(distance, 0, 0),
        heading_rad=np.pi,
        body=dc.bodies.CornerReflector(edge_m=0.15),
    )
    for distance in ranges_m
]
scene = dc.Scene(targets=corners)
rate = 0.1 / 3600  # m/s: 100 mm/h
noise = dc.impairments.ThermalNoise()
backscatter = dc.impairments.RainBackscatter(rate_m_per_s=rate)
attenuation = dc.impairments.RainAttenuation(rate_m_per_s=rate)
weather = {"clear": (noise,), "100 mm/h": (noise, backscatter, attenuation)}
figure, axes = plt.subplots()
peaks_db = {}
for name, impairments in weather.items():
    cube = dc.simulate(scene, radar, impairments=impairments, seed=1).isel(frame=0)
    power = dc.power_map(cube, radar, dc.Chain()).sel(velocity=slice(-10, 10)).max("velocity")
    axes.plot(power.range, 10 * np.log10(power) + 30, label=name)
    peaks_db[name] = [
        10 * np.log10(power.sel(range=slice(distance - 3, distance + 3)).max().item())
        for distance in ranges_m
    ]
axes.set(xlim=(0, 200), xlabel="Range (m)", ylabel="Largest power from -10 to 10 m/s (dBm)")
axes.set_title("Four corner reflectors, in clear air and in a cloudburst")
axes.legend()
losses_db = np.subtract(peaks_db["clear"], peaks_db["100 mm/h"])
amplitudes = [
    abs(dc.simulate(dc.Scene(targets=corners[:1]), radar, impairments=model, seed=1)).mean().item()
    for model in ((), (attenuation,))
]
attenuation_db_per_km = 20 * np.log10(amplitudes[0] / amplitudes[1]) / (2 * ranges_m[0] / 1000)
print(f"Attenuation of rain: {attenuation_db_per_km:.1f} dB/km, one way")
for distance, loss_db in zip(ranges_m, losses_db, strict=True):
    attenuation_db = 2 * distance / 1000 * attenuation_db_per_km
    print(f"{distance:3} m: {loss_db:4.1f} dB less, {attenuation_db:4.1f} dB by attenuation")
