r"""
Skirts of phase noise
=====================

The beat signal contains the difference of the oscillator's phase now and one delay earlier. A
phase-noise mask L(f) therefore appears as :math:`4 L(f) \sin^2 \pi f \tau` on each side of the
line (Beasley, European Radar Conference 2006): weaker close to the line, and zero at
:math:`1 / \tau`. The figure compares the skirt of a target at 90 m, without other noise, with
theory.
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
# Phase noise spreads over all velocities.
power = dc.power_map(cube, radar, dc.Chain()).mean("velocity")

offset_hz = abs(power.range - 90) * chirp.beat_frequency_hz(1)
level = np.interp(
    np.log10(offset_hz.clip(1)), np.log10(mask.offset_hz), np.log10(mask.level_per_hz)
)  # logarithmic interpolation of the mask
delay_s = 90 / 1.499e8
bandwidth_hz = 1.5 * chirp.sample_rate_hz / chirp.n_samples  # noise bandwidth, Hann window
delay_gain = 4 * np.sin(np.pi * offset_hz * delay_s) ** 2
skirt = delay_gain * 10**level * bandwidth_hz * power.max()

figure, axes = plt.subplots()
axes.plot(power.range, 10 * np.log10(power / power.max()), label="simulated")
is_far = abs(power.range - 90) > 5
axes.plot(power.range, 10 * np.log10(skirt / power.max()).where(is_far), label="theory")
axes.set(ylim=(-75, 3), xlabel="Range (m)", ylabel="Power relative to the carrier (dB)")
axes.set_title("A target at 90 m, oscillator of -95 dBc/Hz at 1 MHz")
axes.legend()
for side in (slice(2, 10), slice(40, 80)):
    ratio = power.sel(range=side).mean() / skirt.sel(range=side).mean()
    print(f"{side.start} to {side.stop} m: {ratio.item():.2f} times the predicted power")
