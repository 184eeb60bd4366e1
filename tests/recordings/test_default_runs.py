"""Default runs of the real recordings show the known truth, within tolerances of `TRUTHS`."""

import pytest

from nightly import nightly
from recordings.default_runs import TRUTHS, KnownTruth, run_by_default, select, within

# Another truth of the folder or of the sensor is quicker.
LONG = (
    "people who move",
    "0.50, 0.74 and 0.45 m at 1, 32 and 51 s",
    "person at 0.327 m",
    "-11.2 m/s ± 20 %",
    "3, 11 and 4 m at 1, 9 and 14.5 s, 1.0 and -1.3 m/s",
    "ghost at 27.4 m, 24 m/s",
    "10° at 2.04 m",
    "50° at 2.04 m",
    "-10° and 10° at 2.04 m",
    "-10° at 2.04 m",
    "0.300 and 0.457 m",
    "-14.3 m/s ± 20 %",
    "30° and 50° at 2.04 m",
)


@pytest.mark.parametrize(
    "known",
    [
        pytest.param(
            known,
            id=f"{known.name}: {known.truth}",
            marks=nightly if known.truth in LONG else (),
        )
        for known in TRUTHS
    ],
)
def test_default_run_shows_known_truth(request, known):
    result = run_by_default(known, request.getfixturevalue(f"{known.collection}_data"))

    known.measure(result)
    ranges_m = result.detections.range.values
    assert ranges_m.min() >= 0
    assert ranges_m.max() <= result.radar.frame.chirp.max_range_m


@nightly
@pytest.mark.parametrize("name", ["az_-10", "az_10_1GHz", "az_50_1GHz"])
@pytest.mark.parametrize("is_calibrated", [False, True])
def test_single_reflectors_keep_one_direction(real_data, name, is_calibrated):
    known = KnownTruth(
        "xwr1443_known_angles", f"{name}.raw", "", lambda _: "", is_calibrated=is_calibrated
    )
    result = run_by_default(known, real_data)

    assert within(select(result), 1.99, 2.09).sizes["detection"] == 1
