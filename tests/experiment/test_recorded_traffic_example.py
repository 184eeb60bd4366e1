"""Example `recorded_traffic.py`: scores and figure of a trace."""

import importlib.util
from pathlib import Path

import numpy as np
from matplotlib.image import imread

from nightly import nightly

EXAMPLE = Path(__file__).parents[2] / "examples" / "recorded_traffic.py"


@nightly
def test_example_prints_scores_and_draws_any_trace(tmp_path, capsys):
    specification = importlib.util.spec_from_file_location("recorded_traffic", EXAMPLE)
    example = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(example)
    rows = ["time,id,class,x,y,heading,length,width,height"]
    for k in range(4):
        rows.append(f"{k / 10},475,car,{k},0,0,4.5,1.8,1.5")
        rows.append(f"{k / 10},2,car,{25 + 1.5 * k},0,0,4.5,1.8,1.5")
    (tmp_path / "trace.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")

    arguments = ["--duration", "0.25 s", "--kind", "statistical", "--out", tmp_path / "figure.png"]
    example.main([str(item) for item in (tmp_path / "trace.csv", *arguments)])

    sightings, position, velocity = capsys.readouterr().out.splitlines()
    assert sightings == "5 sightings, 100.0% detected"
    assert float(position.split()[-2]) < 0.5 and float(velocity.split()[-2]) < 0.1
    assert np.ptp(imread(tmp_path / "figure.png")) > 0.5
