"""Commands without a terminal, as in a cron job: plain text and no prompts."""

from faults.conftest import run_shell
from nightly import nightly

NO_TERMINAL_COMMAND = 'setsid --wait "$@" <&-'
DESIGN_OPTIONS = ("--max-range", "200m", "--range-resolution", "1m", "--max-velocity", "60 m/s")


def test_output_without_terminal_is_plain_text():
    process = run_shell(NO_TERMINAL_COMMAND, "design", *DESIGN_OPTIONS, TERM=None, COLUMNS=None)

    assert (process.returncode, process.stderr) == (0, "")
    assert "\x1b" not in process.stdout
    assert "bandwidth" in process.stdout
    assert max(map(len, process.stdout.splitlines())) <= 80


@nightly
def test_run_without_terminal_shows_no_progress_bar(folder):
    process = run_shell(
        NO_TERMINAL_COMMAND, "run", "small.yaml", "--frames", "3", TERM=None, COLUMNS=None
    )

    assert (process.returncode, process.stderr) == (0, "")
    assert "\x1b" not in process.stdout
    assert (folder / "dechirp-run" / "run.json").exists()
