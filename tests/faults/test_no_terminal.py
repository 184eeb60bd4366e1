"""No terminal, as of a cron job: plain text, and nothing is asked."""

from faults.conftest import shell
from nightly import nightly

BARE = 'setsid --wait "$@" <&-'
WANTED = ("--max-range", "200m", "--range-resolution", "1m", "--max-velocity", "60 m/s")


def test_output_is_plain_text():
    ended = shell(BARE, "design", *WANTED, TERM=None, COLUMNS=None)

    assert (ended.returncode, ended.stderr) == (0, "")
    assert "\x1b" not in ended.stdout
    assert "bandwidth" in ended.stdout
    assert max(map(len, ended.stdout.splitlines())) <= 80


@nightly
def test_a_run_shows_no_bar_and_writes_the_same(folder):
    ended = shell(BARE, "run", "small.yaml", "--frames", "3", TERM=None, COLUMNS=None)

    assert (ended.returncode, ended.stderr) == (0, "")
    assert "\x1b" not in ended.stdout
    assert (folder / "dechirp-run" / "run.json").exists()
