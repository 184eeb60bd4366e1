"""Options that a default run prints: copied to the command line, each of them works."""

import json
import re
import shlex
import shutil

import pytest

from dechirp.cli.main import main
from nightly import nightly

RECORDINGS = (
    "real/dca1000_pcap",
    "real/xwr1443_known_angles/az_50.raw",
    "real/xwr1443_known_angles/az_3050.raw",
    "real/awr1642_vibrating_pipe",
    "real/bgt60_breathing",
    "real/bgt60_people_room",
    "real/bgt60_two_reflectors",
    "real/sirad122_walk",
    "witness/ctsai_ddma_near",
    "witness/iwr1843_reflectors",
    "witness/urad_sweeps/IQ_0_1024_sweeps.txt",
    "witness/urad_sweeps/I_trolley_test.txt",
)

_WORD = r"(?:'[^']*'|[^\s;,()']+)"
_OPTION = rf"--(?:set|encoding|format|device|iq|axes|radar|calibration) {_WORD}"
_GROUP = re.compile(rf"{_OPTION}(?: {_OPTION})*|--vital-signs")
_PLACEHOLDER = re.compile(r"\b(?:FILE|NAME|ANGLE|with)\b|cal\.json|radar\.yaml")


def find_suggestions(text: str) -> list[tuple[str, bool]]:
    """Return each group of options in a text, and whether the run chose it."""
    return [
        (match[0], text[: match.start()].endswith("chosen "))
        for match in _GROUP.finditer(text)
        if not _PLACEHOLDER.search(match[0])
    ]


def run(capsys, path, out, options=()):
    """Run the command; return its detections as text, and its findings."""
    with pytest.raises(SystemExit) as exit_status:
        main(["run", str(path), "--out", str(out), "--json", *options])
    captured = capsys.readouterr()
    assert exit_status.value.code == 0, captured.err
    document = json.loads(captured.out)
    texts = [f"{finding['value']}; {finding['fix']}" for finding in document["findings"]]
    return (out / "detections.csv").read_text(), texts


@nightly
@pytest.mark.parametrize("name", RECORDINGS)
def test_suggested_options_can_be_copied(real_data, witness_data, tmp_path, capsys, name):
    collection, _, rest = name.partition("/")
    path = {"real": real_data, "witness": witness_data}[collection] / rest
    detections, texts = run(capsys, path, tmp_path / "out")
    suggestions = dict(part for text in texts for part in find_suggestions(text))

    assert suggestions
    for number, (options, is_chosen) in enumerate(suggestions.items()):
        out = tmp_path / f"copy_{number}"
        copied, _ = run(capsys, path, out, shlex.split(options))
        shutil.rmtree(out)
        if is_chosen:  # the run has them already
            assert copied == detections, options
