"""Leakage of recordings next to zero range, which is no target."""

import re

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.detection_columns import rows_to_show
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.leakage import leakage_findings, leakage_mask
from dechirp.processing.moving_targets import MovingTargetMap
from nightly import nightly
from radars import eight_receiver_radar


def make_detections(range_cells, velocity_cells):
    frame = eight_receiver_radar().frame
    return xr.Dataset(
        {
            "range": ("detection", np.array(range_cells) * frame.chirp.range_resolution_m),
            "velocity": (
                "detection",
                np.array(velocity_cells) * frame.velocity_resolution_m_per_s,
            ),
            "snr": ("detection", np.linspace(100, 50, len(range_cells))),
        }
    )


def test_static_echo_in_main_lobe_of_zero_range_is_leakage():
    radar, chain = eight_receiver_radar(), dc.Chain()
    # A Hann window has a main lobe of two cells to each side.
    detections = make_detections([1.9, 2.1, 1.0, 0.0, 30], [0.1, 0.1, 3.0, 3.0, np.nan])

    mask = leakage_mask(detections, radar, chain)

    assert mask.tolist() == [True, False, False, True, False]
    (finding,) = leakage_findings(detections, radar, chain)
    assert finding.value.startswith("2 detections at 0.00 to 1.")
    (finding,) = leakage_findings(detections.isel(detection=[3]), radar, chain)
    assert finding.value.startswith("1 detection at 0.00 m: ")
    assert leakage_findings(detections.isel(detection=[1]), radar, chain) == ()
    rows = rows_to_show(
        detections, 20, range_cell_m=1.0, velocity_cell_m_per_s=1.0, is_leakage=mask
    )
    assert rows.tolist() == [1, 2, 4]


def test_echo_in_main_lobe_of_zero_range_whose_motion_is_unconfirmed_is_leakage():
    detections = make_detections([1.0, 1.0, 30], [2.3, 2.3, 2.3])
    detections["moving"] = ("detection", np.array([np.nan, 1, np.nan]))
    radar, moving_targets = eight_receiver_radar(), MovingTargetMap()

    mask = leakage_mask(detections, radar, dc.Chain(moving_targets=moving_targets))

    assert mask.tolist() == [True, False, False]
    assert not leakage_mask(detections, radar, dc.Chain()).any()


def test_leakage_has_no_note_on_the_near_field(real_data):
    recording = RecordingSource(path=str(real_data / "dca1000_pcap" / "one_frame.pcap"))
    result = dc.run(dc.Scenario(recording=recording))

    assert any("leakage" in finding.value for finding in result.findings)
    assert not any("near field" in finding.value for finding in result.findings)


@nightly
def test_leakage_of_a_recording_is_named_and_left_out_of_the_table(
    real_data, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)

    with pytest.raises(SystemExit):
        main(["run", str(real_data / "xwr1443_known_angles"), "--out", "run"])

    out = capsys.readouterr().out
    rows = re.findall(r"^ *(\d+\.\d+) \u00b1", out, re.MULTILINE)
    assert rows and min(map(float, rows)) > 0.5
    assert "2 detections at 0.00 to 0.08 m: probably leakage" in " ".join(out.split())
