"""A study of a small radar that keeps a data set, for those who start and kill it.

python tests/data_set_study.py OUT
"""

import hashlib
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import dechirp as dc
from dechirp.evaluation.score.detection_probability import DetectionProbability
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study.study import StopRule, Study, SweptSetting, TrialBudget
from dechirp.simulation.impairments.thermal_noise import ThermalNoise
from trial_cases import small, target

SCENE = dc.Scene(targets=(target(name="car"), target(41.3, -5.0, name="van", rcs_m2=3.0)))
RCS = SweptSetting(
    path="scene.targets.car.rcs",
    texts=("-20 dBsm", "-10 dBsm", "0 dBsm"),
    numbers=(-20.0, -10.0, 0.0),
    unit="dBsm",
)
ALL = ("cubes", "maps", "detections")


def study(**changed) -> Study:
    """Three points of 23 trials of two targets, in blocks of 5, the last one short."""
    settings = {
        "scenario": Scenario(scene=SCENE, radar=small(2), impairments=(ThermalNoise(),)),
        "seed": 3,
        "vary": (RCS,),
        "trials": TrialBudget(at_most=23, block=5),
        "scores": (DetectionProbability(),),
        "keep": ALL,
    }
    return Study(**{**settings, **changed})


def adaptive() -> Study:
    """The same, each point until its probability is known to 0.5."""
    until = StopRule(score="detection_probability", width=0.5)
    return study(trials=replace(study().trials, until=until))


def run(out: Path, asked: Study | None = None, **told):
    """Run it on one thread."""
    with ThreadPoolExecutor(1) as pool:
        return dc.run_study(asked or study(), out, executor=pool, **told)


def fingerprint(out: Path) -> dict[str, str]:
    """SHA-256 of every file of the data set, by its name."""
    folder = out / "data.zarr"
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


if __name__ == "__main__":
    print("started", flush=True)
    run(Path(sys.argv[1]))
