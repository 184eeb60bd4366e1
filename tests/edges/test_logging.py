"""Log records under the name `dechirp`, which are silent without handlers of an application."""

import logging
import subprocess
import sys

import dechirp as dc


def test_run_logs_findings_and_times_of_its_stages(caplog):
    scenario = dc.reference()
    with caplog.at_level(logging.INFO, logger="dechirp"):
        result = dc.run(scenario)

    records = [record for record in caplog.records if record.name.startswith("dechirp.")]
    findings = {(record.levelname, record.getMessage()) for record in records[:-1]}
    levels = {"note": "INFO", "warning": "WARNING", "error": "ERROR"}
    assert findings == {(levels[finding.level], str(finding)) for finding in result.findings}
    for stage in result.timing_s:
        assert f"{stage} " in records[-1].getMessage()


def test_warnings_are_not_printed_without_a_handler():
    """Without the null handler, Python would print them to the standard error stream."""
    code = "import dechirp, logging; logging.getLogger('dechirp.run').warning('surprise')"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert process.stdout + process.stderr == ""
