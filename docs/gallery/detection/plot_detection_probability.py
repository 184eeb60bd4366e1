"""
Detection probability of steady and fading targets
==================================================

A car fades because its reflections interfere. Swerling's models (IRE Transactions IT-6, 1960)
predict the loss: at a detection probability of 0.9 and a false-alarm probability of 1e-6 it is
8 dB for equal scatterers (Swerling 1) and 4 dB with one dominant scatterer (Swerling 3). The
figure compares trials, with 95 % intervals, with theory.
"""

import tempfile
from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt

import dechirp as dc

radar = dc.design(
    max_range_m=30,
    range_resolution_m=0.5,
    max_velocity_m_per_s=10,
    velocity_resolution_m_per_s=0.6,
    rule="constraints",
).radar
levels_db = range(-28, -7, 2)
models = ("steady", "swerling-3", "swerling-1")
texts = tuple(f"{curve} dB" for curve in levels_db)
levels = dc.studies.SweptSetting(path="impairments.white-noise.snr", texts=texts)
study = dc.Study(
    scenario=dc.Scenario(
        radar=radar,
        scene=dc.Scene(targets=[dc.Target(name="car", position_m=(20, 0, 0))]),
        impairments=(dc.impairments.WhiteNoise(snr=1e-3),),
        chain=dc.Chain(range_window="rectangular", doppler_window="rectangular"),
    ),
    vary=(
        dc.studies.SweptSetting(path="scene.targets.car.fluctuation", texts=models),
        levels,
    ),
    trials=dc.studies.TrialBudget(at_most=40),
    scores=(dc.scores.DetectionProbability(),),
    seed=1,
)
with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
    scores = dc.run_study(study, folder, executor=executor).result.dataset

figure, axes = plt.subplots()
for index, model in enumerate(models):
    curve = scores.sel({"scene.targets.car.fluctuation": model})
    probability, low, high, theory = (
        curve[f"detection_probability{end}"] for end in ("", "_low", "_high", "_theory")
    )
    axes.plot(levels_db, theory, color=f"C{index}")
    error = (probability - low, high - probability)
    axes.errorbar(levels_db, probability, error, fmt="o", color=f"C{index}", capsize=3, label=model)
    print(f"{model}: largest difference {abs(probability - theory).max():.2f}")
axes.set(xlabel="SNR per sample (dB)", ylabel="Detection probability")
axes.set_title("Trials with 95 % intervals, and theory")
axes.legend(loc="lower right")
