"""
A recording, written and read back
==================================

Simulated cubes can be written in foreign formats, read back and processed with the same chain:
here a binary file of a TI DCA1000 board with 16-bit words, with its settings file. The figure
shows both range profiles and the difference caused by the word length.
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
array = dc.Array(rx_m=[(0, 1.94e-3 * element, 0) for element in range(4)])
radar = dataclasses.replace(design_radar, array=array)
scene = dc.Scene(targets=[dc.Target(position_m=(25, 4, 0), velocity_m_per_s=(5, 0, 0), rcs_m2=10)])
cube = dc.simulate(scene, radar, seed=1)
with tempfile.TemporaryDirectory() as folder:
    paths = dc.write(dc.recording_from_cube(cube, radar), Path(folder) / "capture.bin")
    print("written:", ", ".join(path.name for path in paths))
    recording = dc.open(paths[0])
    loaded_cube = recording.cube.load()

figure, axes = plt.subplots()
chain = dc.Chain()
original, reloaded, difference = (
    dc.power_map(samples.isel(frame=0), radar, chain).sel(velocity=5, method="nearest")
    for samples in (cube, loaded_cube, loaded_cube.copy(data=loaded_cube.values - cube.values))
)
axes.plot(original.range, 10 * np.log10(original) + 30, linewidth=4, alpha=0.4, label="simulated")
axes.plot(reloaded.range, 10 * np.log10(reloaded) + 30, label="read back")
axes.plot(difference.range, 10 * np.log10(difference) + 30, label="difference")
axes.set(xlabel="Range (m)", ylabel="Power at 5 m/s (dBm)")
axes.set_title("A car at 25 m, before and after a file of 16-bit words")
axes.legend()
for name, samples in (("simulated", cube), ("read back", loaded_cube)):
    detections = dc.detect(samples, radar)
    print(f"{name}: {detections.range[0].item():.4f} m, {detections.velocity[0].item():.4f} m/s")
