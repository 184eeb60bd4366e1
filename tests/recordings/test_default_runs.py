"""Default runs of the real recordings show the known truth, within tolerances of `TRUTHS`."""

import pytest

from recordings.default_runs import TRUTHS, run_by_default


@pytest.mark.parametrize(
    "known", [pytest.param(known, id=f"{known.name}: {known.truth}") for known in TRUTHS]
)
def test_default_run_shows_known_truth(request, known):
    result = run_by_default(known, request.getfixturevalue(f"{known.collection}_data"))

    known.measure(result)
    ranges_m = result.detections.range.values
    assert ranges_m.min() >= 0
    assert ranges_m.max() <= result.radar.frame.chirp.max_range_m
