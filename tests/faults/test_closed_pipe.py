"""A reader that leaves, as `head` does: no error, status 141, and results are whole."""

import json

from faults.conftest import shell
from nightly import nightly


@nightly
def test_nobody_reads_and_results_are_kept(folder):
    line = 'set -o pipefail; "$@" | :'
    ended = shell(line, "run", "small.yaml", "--json", "--out", "out")

    assert (ended.returncode, ended.stdout, ended.stderr) == (141, "", "")
    assert json.loads((folder / "out" / "run.json").read_text())["detections"]
