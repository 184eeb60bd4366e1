r"""
Skirts of phase noise
=====================

An echo carries the oscillator's phase less what it was a delay ago. So a mask L(f) comes out as
:math:`4 L(f) \sin^2 \pi f \tau` on each side of the line (Beasley, European Radar Conference
2006): less near it, and nothing at :math:`1 / \tau`. See the skirt of a target 90 m away, with
no other noise, on the curve of theory.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

radar = dc.design(
    max_range_m=150, range_resolution_m=1, max_velocity_m_per_s=20, rule="constraints"
).radar
chirp = radar.frame.chirp
mask = dc.impairments.PhaseNoise(
    offset_hz=(1e5, 1e6, 1e7), level_per_hz=(10**-7.5, 10**-9.5, 10**-11.5)
)
scene = dc.Scene(targets=[dc.Target(position_m=(90, 0, 0), rcs_m2=100)])
cube = dc.simulate(scene, radar, impairments=(mask,), seed=1).isel(frame=0)
power = dc.power_map(cube, radar, dc.Chain()).mean("velocity")  # it is spread over all of them

offset_hz = abs(power.range - 90) * chirp.beat_frequency_hz(1)
level = np.interp(
    np.log10(offset_hz.clip(1)), np.log10(mask.offset_hz), np.log10(mask.level_per_hz)
)  # straight lines between decades
delay_s = 90 / 1.499e8
bandwidth_hz = 1.5 * chirp.sample_rate_hz / chirp.n_samples  # of a cell under a Hann window
turned = 4 * np.sin(np.pi * offset_hz * delay_s) ** 2
skirt = turned * 10**level * bandwidth_hz * power.max()

figure, axes = plt.subplots()
axes.plot(power.range, 10 * np.log10(power / power.max()), label="simulated")
far = abs(power.range - 90) > 5
axes.plot(power.range, 10 * np.log10(skirt / power.max()).where(far), label="theory")
axes.set(ylim=(-75, 3), xlabel="Range (m)", ylabel="Power relative to the carrier (dB)")
axes.set_title("A target at 90 m, seen with an oscillator of -95 dBc/Hz at 1 MHz")
axes.legend()
side = slice(40, 80)
ratio = power.sel(range=side).mean() / skirt.sel(range=side).mean()
print(f"from 40 to 80 m the skirt has {ratio.item():.2f} times the power of theory")
