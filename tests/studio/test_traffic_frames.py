"""Frames of traffic in the studio."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.models import Column

import dechirp as dc
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.page import build_live_page
from dechirp.studio.scenario_edits import PageLimits, apply_overrides
from nightly import nightly

TRACE = """time,id,class,x,y,heading,length,width,height
0.0,1,car,0,0,0,4.5,1.8,1.5
0.2,1,car,2,0,0,4.5,1.8,1.5
0.0,2,car,20,0.5,0,4.5,1.8,1.5
0.2,2,car,22.4,0.5,0,4.5,1.8,1.5
"""


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "trace.csv"
    path.write_text(TRACE, encoding="utf-8")
    return dc.traffic.traffic_scenario(path, ["traffic.ego=1", "radar.frame.n_chirps=64"])


def test_steps_show_the_frames_of_a_run_and_repeat(scenario):
    result = dc.run(scenario)
    player = FramePlayer(scenario, PageLimits())

    states = [player.process_frame_at_step(step, None) for step in range(result.n_frames + 1)]

    assert [state.number for state in states] == [*range(result.n_frames), 0]
    for state in states[:-1]:
        of_frame = result.detections["frame"].values == state.number
        assert state.detections["range"].values.tolist() == (
            result.detections["range"].values[of_frame].tolist()
        )
        assert state.scene.names == ("car-2",)
        # Car 2 recedes at 2 m/s from a front 2.25 m ahead of the centre of car 1.
        offsets_m = state.scene.target_positions_m(state.truth["time"].values)[0, 0]
        expected_m = 20 - 2.25 + 2 * state.time_s
        assert offsets_m[0] == pytest.approx(expected_m, abs=1e-6)
        assert state.truth["range"].item() == pytest.approx(np.linalg.norm(offsets_m), abs=1e-9)


@nightly
def test_page_of_traffic_has_no_empty_layout(scenario):
    document = Document()

    async def build_page():
        build_live_page(document, worker=worker, scenario=scenario, limits=PageLimits())

    with ThreadPoolExecutor(1) as worker:
        asyncio.run(build_page())
    columns = list(document.select({"type": Column}))
    assert columns and all(column.children for column in columns)


def test_page_cannot_name_files_outside_its_folders(scenario):
    with pytest.raises(dc.DechirpError, match="expected a file in the folders of the studio"):
        apply_overrides(scenario, ["traffic.path=/etc/passwd"], PageLimits())
    changed = apply_overrides(scenario, ["traffic.mount=rear"], PageLimits())
    assert changed.traffic.mount == "rear"
