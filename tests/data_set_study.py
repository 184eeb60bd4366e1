"""Study of a small radar that keeps a data set, for tests that start and kill it.

python tests/data_set_study.py OUT
"""

import hashlib
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import dechirp as dc
from dechirp.evaluation.score.probabilities import DetectionProbability
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study.study import StopRule, Study, SweptSetting, TrialBudget
from dechirp.simulation.impairments.noise import ThermalNoise
from trial_cases import make_target, small_radar

SCENE = dc.Scene(targets=(make_target(name="car"), make_target(41.3, -5.0, name="van", rcs_m2=3.0)))
RCS = SweptSetting(
    path="scene.targets.car.rcs",
    texts=("-20 dBsm", "-10 dBsm", "0 dBsm"),
    numbers=(-20.0, -10.0, 0.0),
    unit="dBsm",
)
ALL_PARTS = ("cubes", "maps", "detections")


def make_study(**changes) -> Study:
    """Return a study of 3 points, 23 trials and 2 targets, in blocks of 5, the last one short."""
    settings = {
        "scenario": Scenario(scene=SCENE, radar=small_radar(2), impairments=(ThermalNoise(),)),
        "seed": 3,
        "vary": (RCS,),
        "trials": TrialBudget(at_most=23, block=5),
        "scores": (DetectionProbability(),),
        "keep": ALL_PARTS,
    }
    return Study(**{**settings, **changes})


def make_adaptive_study() -> Study:
    """Return the study with a stop rule: until the probability is known to 0.5."""
    until = StopRule(score="detection_probability", width=0.5)
    return make_study(trials=replace(make_study().trials, until=until))


def run_to_folder(out: Path, study: Study | None = None, **options):
    """Run a study on one thread."""
    with ThreadPoolExecutor(1) as pool:
        return dc.run_study(study or make_study(), out, executor=pool, **options)


def file_digests(out: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of the data set by name."""
    folder = out / "data.zarr"
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


if __name__ == "__main__":
    print("started", flush=True)
    run_to_folder(Path(sys.argv[1]))
