"""Placement of target labels in the top view."""

import numpy as np

from dechirp.studio.views.ground import TopView, choose_label_offsets


def test_single_label_lies_on_outer_side():
    positions = np.array([[0.3, 0.5], [-0.3, 0.5]])  # left and right of the radar

    labels = choose_label_offsets(positions, ["car", "van"])

    assert labels["align"] == ["right", "left"]  # text ends, and starts, at its marker
    assert labels["down"] == [0, 0]
    assert labels["away"][0] < 0 < labels["away"][1]


def test_labels_of_coincident_targets_have_different_places():
    labels = choose_label_offsets(
        np.array([[0.2, 0.5], [0.2, 0.5], [0.2, 0.5]]), ["car", "bicyclist", "post"]
    )

    placements = list(zip(labels["align"], labels["down"], strict=True))
    assert len(set(placements)) == 3


def test_label_avoids_marker_of_other_target():
    # The second target lies at the default label position of the first.
    labels = choose_label_offsets(np.array([[-0.2, 0.5], [-0.32, 0.5]]), ["car", "post"])

    assert (labels["align"][0], labels["down"][0]) != ("left", 0)


def test_axes_name_rings_and_no_text_stands_among_targets():
    view = TopView("scene")
    view.set_max_range_and_field_of_view(150.0, np.pi / 3)

    (axis_x,), (axis_y,) = view.figure.xaxis, view.figure.yaxis
    assert axis_x.ticker.ticks == [-200.0, -150.0, -100.0, -50.0, 0.0, 50.0, 100.0, 150.0, 200.0]
    assert axis_y.ticker.ticks == [0.0, 50.0, 100.0, 150.0, 200.0]
    rings = next(
        renderer.data_source.data
        for renderer in view.figure.renderers
        if np.nanmax(np.hypot(*map(renderer.data_source.data.get, "xy")), initial=0) > 199
        and np.isnan(renderer.data_source.data["x"]).any()
    )
    radii_m = np.hypot(rings["x"], rings["y"])
    assert sorted(set(radii_m[np.isfinite(radii_m)].round().tolist())) == [50, 100, 150, 200]
    texts = [
        text
        for renderer in view.figure.renderers
        for text in renderer.data_source.data.get("text", [])
    ]
    assert texts == []
