"""Closed output pipe, as with `head`: status 141, no error and complete results."""

import json

from faults.conftest import run_shell
from nightly import nightly


@nightly
def test_closed_pipe_ends_with_141_and_complete_results(folder):
    line = 'set -o pipefail; "$@" | :'
    process = run_shell(line, "run", "small.yaml", "--json", "--out", "out")

    assert (process.returncode, process.stdout, process.stderr) == (141, "", "")
    assert json.loads((folder / "out" / "run.json").read_text())["detections"]
