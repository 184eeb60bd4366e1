"""Saved invalid inputs of every entry point: each gives a value or a complete error.

`corpus/ENTRY/` contains inputs that once caused failures, and typical invalid inputs.
"""

import signal

import pytest

from bad_input.entries import CORPUS, ENTRIES, replay_input
from nightly import NIGHTLY

TIME_LIMIT_S = 60
"""Limit of CPU time per file, compiled loops included; the slowest file takes 0.5 s without."""
MAX_FILES_BY_DAY = 7
"""Number of files per entry, evenly spaced; nightly runs use all files."""


@pytest.fixture(autouse=True)
def time_limit():
    """Stop a test that exceeds the limit."""

    def fail(_number, _frame):
        pytest.fail(f"took more than {TIME_LIMIT_S} s of CPU time")

    if not hasattr(signal, "SIGPROF"):  # Windows has no timers of CPU time
        yield
        return
    previous_handler = signal.signal(signal.SIGPROF, fail)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.signal(signal.SIGPROF, previous_handler)


@pytest.mark.parametrize("entry", ENTRIES)
def test_saved_inputs_give_value_or_complete_error(entry, tmp_path):
    files = sorted((CORPUS / entry).iterdir())
    assert files
    if not NIGHTLY:
        files = files[:: -(-len(files) // MAX_FILES_BY_DAY)]
    failures = []
    for file in files:
        if hasattr(signal, "SIGPROF"):
            signal.setitimer(signal.ITIMER_PROF, TIME_LIMIT_S)
        scratch = tmp_path / "scratch" / file.name
        scratch.mkdir(parents=True)
        try:
            replay_input(entry, file, scratch)
        except (Exception, SystemExit) as error:
            failures.append(f"{file.name}: {type(error).__name__}: {error}")
    assert not failures, "\n".join(failures)
