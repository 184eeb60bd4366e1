"""Placement of target labels in the top view."""

import numpy as np

from dechirp.studio.views.ground import centred_label_boxes, choose_label_offsets


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


def test_label_avoids_range_ring_label():
    position, ring = np.array([[-0.2, 0.4]]), np.array([[-0.35, 0.4]])
    free_label = choose_label_offsets(position, ["car"])
    displaced_label = choose_label_offsets(position, ["car"], centred_label_boxes(ring, ["50 m"]))

    assert (free_label["align"], free_label["down"]) == (["left"], [0])
    assert (displaced_label["align"], displaced_label["down"]) != (
        free_label["align"],
        free_label["down"],
    )
