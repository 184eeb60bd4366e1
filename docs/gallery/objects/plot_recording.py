"""
A recording, written and read back
==================================

What is simulated can be written in the formats of others and goes through the same chain when it
is read: here the binary file of a TI DCA1000 board, with words of 16 bits, beside its settings
file. See the profile of both, and the difference that the words leave.
"""

import dataclasses
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

design_radar = dc.design(
    max_range_m=60, range_resolution_m=0.5, max_velocity_m_per_s=20, rule="constraints"
).radar
array = dc.Array(rx_m=[(0, 1.94e-3 * place, 0) for place in range(4)])
radar = dataclasses.replace(design_radar, array=array)
scene = dc.Scene(targets=[dc.Target(position_m=(25, 4, 0), velocity_m_per_s=(5, 0, 0), rcs_m2=10)])
cube = dc.simulate(scene, radar, seed=1)
with tempfile.TemporaryDirectory() as folder:
    written = dc.write(dc.recording_from_cube(cube, radar), Path(folder) / "capture.bin")
    print("written:", ", ".join(path.name for path in written))
    recording = dc.open(written[0])
    again = recording.cube.load()

figure, axes = plt.subplots()
chain = dc.Chain()
before, after, apart = (
    dc.power_map(samples.isel(frame=0), radar, chain).sel(velocity=5, method="nearest")
    for samples in (cube, again, again.copy(data=again.values - cube.values))
)
axes.plot(before.range, 10 * np.log10(before) + 30, linewidth=4, alpha=0.4, label="simulated")
axes.plot(after.range, 10 * np.log10(after) + 30, label="read back")
axes.plot(apart.range, 10 * np.log10(apart) + 30, label="difference")
axes.set(xlabel="Range (m)", ylabel="Power at 5 m/s (dBm)")
axes.set_title("A car at 25 m, before and after a file of 16-bit words")
axes.legend()
for name, samples in (("simulated", cube), ("read back", again)):
    detections = dc.detect(samples, radar)
    print(f"{name}: {detections.range[0].item():.4f} m, {detections.velocity[0].item():.4f} m/s")
