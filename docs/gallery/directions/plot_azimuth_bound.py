r"""
Azimuth errors and the Cramér-Rao bound
=======================================

For L elements at half a wavelength, the Cramér-Rao bound of azimuth is
:math:`\sqrt{6 / (\eta L (L^2 - 1))} / (\pi \cos \phi)`, where :math:`\eta` is the signal-to-noise
ratio in one element (Stoica and Nehorai, IEEE T-ASSP 37, 1989). The figure compares beamforming
with phase comparison of neighbouring elements, which uses less of the aperture.
"""

import dataclasses
import tempfile
from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

design_radar = dc.design(
    max_range_m=12, range_resolution_m=0.5, max_velocity_m_per_s=50, rule="constraints"
).radar
array = dc.Array(rx_m=[(0, 1.94e-3 * element, 0) for element in range(6)])
levels_db = tuple(range(-20, 1, 5))
texts = tuple(f"{level} dB" for level in levels_db)
levels = dc.studies.SweptSetting(path="impairments.white-noise.snr", texts=texts)
study = dc.Study(
    scenario=dc.Scenario(
        radar=dataclasses.replace(design_radar, array=array),
        scene=dc.Scene(targets=[dc.Target(name="car", position_m=(8, 1.2, 0))]),
        impairments=(dc.impairments.WhiteNoise(snr=1.0),),
        chain=dc.Chain(range_window="rectangular", doppler_window="rectangular"),
    ),
    vary=(
        dc.studies.SweptSetting(path="chain.angle.kind", texts=("fft", "monopulse")),
        levels,
    ),
    trials=dc.studies.TrialBudget(at_most=80),
    scores=(dc.scores.AzimuthRmse(),),
    seed=1,
)
with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
    scores = dc.run_study(study, folder, executor=executor).result.dataset

figure, axes = plt.subplots()
for index, kind in enumerate(scores["chain.angle.kind"].values):
    curve = scores.sel({"chain.angle.kind": kind})
    error, low, high, bound = (
        np.rad2deg(curve[f"azimuth_rmse{end}"]) for end in ("", "_low", "_high", "_theory")
    )
    spread = (error - low, high - error)
    axes.errorbar(levels_db, error, spread, fmt="o", color=f"C{index}", capsize=3, label=kind)
    print(f"{kind}: {(error / bound).mean().item():.2f} of the bound")
axes.semilogy(levels_db, bound, color="0.5", label="Cramér-Rao bound")
axes.set(xlabel="SNR per sample (dB)", ylabel="Azimuth RMSE (°)")
axes.set_title("Six elements, trials with 95 % intervals")
axes.legend()
