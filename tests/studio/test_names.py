"""Names beside places in the view from above."""

import numpy as np

from dechirp.studio.views.ground import centred_label_boxes, place_labels


def test_a_name_alone_stands_on_the_side_that_is_not_the_middles():
    places = np.array([[0.3, 0.5], [-0.3, 0.5]])  # left and right of the radar

    made = place_labels(places, ["car", "van"])

    assert made["align"] == ["right", "left"]  # they end, and begin, beside their places
    assert made["down"] == [0, 0]
    assert made["away"][0] < 0 < made["away"][1]


def test_names_of_targets_at_one_place_stand_apart():
    made = place_labels(
        np.array([[0.2, 0.5], [0.2, 0.5], [0.2, 0.5]]), ["car", "bicyclist", "post"]
    )

    stands = list(zip(made["align"], made["down"], strict=True))
    assert len(set(stands)) == 3


def test_a_name_leaves_the_mark_of_another_target_free():
    # The second target stands where the name of the first would.
    made = place_labels(np.array([[-0.2, 0.5], [-0.32, 0.5]]), ["car", "post"])

    assert (made["align"][0], made["down"][0]) != ("left", 0)


def test_a_name_leaves_the_name_of_a_range_ring_free():
    place, ring = np.array([[-0.2, 0.4]]), np.array([[-0.35, 0.4]])
    alone = place_labels(place, ["car"])
    kept = place_labels(place, ["car"], centred_label_boxes(ring, ["50 m"]))

    assert (alone["align"], alone["down"]) == (["left"], [0])
    assert (kept["align"], kept["down"]) != (alone["align"], alone["down"])
