"""Saved inputs that no entry point expects: each gives a value, or an error that says all of it.

What once broke something is kept in `corpus/ENTRY/`, beside what is wrong in an ordinary way.
"""

import signal

import pytest

from bad_input.entries import CORPUS, ENTRIES, replayed
from nightly import NIGHTLY

SECONDS = 20
"""For one file on a machine with much else to do; the slowest takes half a second."""
MOST_BY_DAY = 20
"""Of an entry, spread evenly over its files; all of them by night."""


@pytest.fixture(autouse=True)
def ends():
    """End what hangs."""

    def stop(_number, _frame):
        pytest.fail(f"took more than {SECONDS} s")

    if not hasattr(signal, "SIGALRM"):  # not on Windows
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(SECONDS)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("entry", ENTRIES)
def test_every_saved_input_gives_a_value_or_says_what_is_wrong(entry, tmp_path):
    files = sorted((CORPUS / entry).iterdir())
    assert files
    if not NIGHTLY:
        files = files[:: -(-len(files) // MOST_BY_DAY)]
    wrong = []
    for file in files:
        signal.alarm(SECONDS)
        scratch = tmp_path / "scratch" / file.name
        scratch.mkdir(parents=True)
        try:
            replayed(entry, file, scratch)
        except (Exception, SystemExit) as error:
            wrong.append(f"{file.name}: {type(error).__name__}: {error}")
    assert not wrong, "\n".join(wrong)
