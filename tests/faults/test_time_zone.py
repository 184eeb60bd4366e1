"""Time zones: dates in files are UTC in every zone."""

import time

import pytest

from dechirp.report.template import format_date_and_time
from faults.test_locale import read_results
from nightly import nightly

pytestmark = pytest.mark.skipif(
    not hasattr(time, "tzset"), reason="this platform cannot set a time zone"
)


@pytest.fixture
def set_zone(monkeypatch):
    """Return a function that sets the time zone; Kathmandu is UTC+5:45."""

    def set_time_zone(name: str) -> None:
        monkeypatch.setenv("TZ", name)
        time.tzset()

    yield set_time_zone
    monkeypatch.delenv("TZ", raising=False)
    time.tzset()


@pytest.mark.parametrize(
    "iso", ["2026-12-31T23:30:00+00:00", "2027-01-01T05:15:00+05:45", "2026-12-31T23:30:00"]
)
def test_dates_are_shown_in_utc(iso, set_zone):
    set_zone("Asia/Kathmandu")
    assert format_date_and_time(iso) == "31 December 2026, 23:30 UTC"


@nightly
def test_results_do_not_depend_on_time_zone(folder, call, set_zone):
    set_zone("Asia/Kathmandu")
    assert time.timezone == -20700
    assert call("run", "small.yaml", "--out", "east", "--quiet")[0] == 0
    assert call("convert", "in.npz", "east.npz", "--quiet")[0] == 0
    set_zone("America/St_Johns")
    assert call("run", "small.yaml", "--out", "west", "--quiet")[0] == 0
    assert call("convert", "in.npz", "west.npz", "--quiet")[0] == 0

    assert read_results(folder / "east") == read_results(folder / "west")
    assert (folder / "east.npz").read_bytes() == (folder / "west.npz").read_bytes()
