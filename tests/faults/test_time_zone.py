"""Time zones: dates in files are UTC, wherever somebody works."""

import time

import pytest

from dechirp.report.template import format_date
from faults.test_decimal_comma import results

pytestmark = pytest.mark.skipif(not hasattr(time, "tzset"), reason="no time zone to be set here")


@pytest.fixture
def zone(monkeypatch):
    """Have this process in a time zone: Kathmandu is 5 h 45 min before UTC."""

    def begin(name: str) -> None:
        monkeypatch.setenv("TZ", name)
        time.tzset()

    yield begin
    monkeypatch.delenv("TZ", raising=False)
    time.tzset()


@pytest.mark.parametrize(
    "iso", ["2026-12-31T23:30:00+00:00", "2027-01-01T05:15:00+05:45", "2026-12-31T23:30:00"]
)
def test_a_date_is_shown_in_utc(iso, zone):
    zone("Asia/Kathmandu")
    assert format_date(iso) == "31 December 2026, 23:30 UTC"


def test_results_are_the_same_to_the_byte(folder, call, zone):
    zone("Asia/Kathmandu")
    assert time.timezone == -20700
    assert call("run", "small.yaml", "--out", "east", "--quiet")[0] == 0
    assert call("convert", "in.npz", "east.npz", "--quiet")[0] == 0
    zone("America/St_Johns")
    assert call("run", "small.yaml", "--out", "west", "--quiet")[0] == 0
    assert call("convert", "in.npz", "west.npz", "--quiet")[0] == 0

    assert results(folder / "east") == results(folder / "west")
    assert (folder / "east.npz").read_bytes() == (folder / "west.npz").read_bytes()
