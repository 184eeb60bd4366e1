r"""
Specified and measured false alarms
===================================

The factor between noise level and threshold follows from the false-alarm probability and the number
of training cells, :math:`\alpha = N (P^{-1/N} - 1)` (Finn and Johnson, RCA Review 29, 1968).
Windows correlate neighbouring cells and change the factor. The figure shows the probabilities
measured in maps of noise; they agree with the specified ones within the 95 % intervals.
"""

import tempfile
from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt

import dechirp as dc

radar = dc.design(
    max_range_m=30,
    range_resolution_m=0.5,
    max_velocity_m_per_s=10,
    velocity_resolution_m_per_s=0.4,
    rule="constraints",
).radar
cfar = dc.Cfar(
    estimator=dc.cfar.CellAveraging(),
    n_training=dc.Cells(range=4, velocity=3),
    n_guard=dc.Cells(range=2, velocity=2),
    false_alarm_probability=1e-3,
)
specified_probabilities = (1e-2, 1e-3, 1e-4, 1e-5)
study = dc.Study(
    scenario=dc.Scenario(radar=radar, scene=dc.Scene(), chain=dc.Chain(cfar=cfar)),
    vary=(
        dc.studies.SweptSetting(
            path="chain.cfar.false_alarm_probability",
            texts=tuple(map(str, specified_probabilities)),
        ),
    ),
    trials=dc.studies.TrialBudget(at_most=200),
    scores=(dc.scores.FalseAlarmProbability(),),
    seed=1,
)
with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
    scores = dc.run_study(study, folder, executor=executor).result.dataset

ratio = scores.false_alarm_probability / specified_probabilities
low, high = (
    scores[f"false_alarm_probability_{end}"] / specified_probabilities for end in ("low", "high")
)
figure, axes = plt.subplots()
axes.errorbar(specified_probabilities, ratio, yerr=(ratio - low, high - ratio), fmt="o", capsize=4)
axes.axhline(1, color="0.5", linestyle=":")
axes.set(xscale="log", ylim=(0, 3), xlabel="Specified false-alarm probability")
axes.set_ylabel("Measured over specified false-alarm probability")
axes.set_title("False alarms of cell averaging under Hann windows, 95 % intervals")
for specified, value in zip(
    specified_probabilities, scores.false_alarm_probability.values, strict=True
):
    print(f"specified {specified:.0e}, measured {value:.2e}")
