"""`dechirp verify`: JSON document, terminal output, reproducibility, errors, interruption."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import psutil
import pytest
from markupsafe import Markup

import dechirp as dc
from dechirp.certificate import certificate, every_detector, extended, false_alarms
from dechirp.certificate.certificate import CLAIM_IDS, verify
from dechirp.certificate.document import certificate_as_json_data, checksum_of_numbers
from dechirp.certificate.trials import Job
from dechirp.cli.main import main
from dechirp.results.text_files import to_json_text
from nightly import nightly

CLAIM_KEYS = ["id", "claim", "published", "required", "measured", "limit", "passed"]


def reduce_trials(jobs: dict[str, Job]) -> dict[str, Job]:
    """Return the jobs with a hundredth of their trials, too few to certify anything."""
    return {
        name: replace(job, n_trials=max(job.n_trials // 100, 3), block_size=20)
        for name, job in jobs.items()
    }


@pytest.fixture(autouse=True)
def reduced_trials(monkeypatch):
    """Reduce the number of trials, and replace worker processes by a thread."""
    original_jobs = certificate._trial_jobs_of_report_claims
    monkeypatch.setattr(
        certificate,
        "_trial_jobs_of_report_claims",
        lambda *arguments, **options: reduce_trials(original_jobs(*arguments, **options)),
    )
    original_workers = certificate.workers_from_executor
    single_thread = ThreadPoolExecutor(1)
    monkeypatch.setattr(
        certificate,
        "workers_from_executor",
        lambda executor: original_workers(executor or single_thread),
    )
    yield
    single_thread.shutdown()


@cache
def default_certificate() -> certificate.Certificate:
    """Return a certificate of few trials, computed in the first test that needs it."""
    return verify()


@pytest.fixture
def run_cli(capsys, tmp_path, monkeypatch):
    """Return a function that runs the command line in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as exit_info:
            main(["verify", *arguments])
        return exit_info.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def without_paper_figures(monkeypatch):
    """Leave the figures out of the report: they take most of the time of a short certificate."""
    monkeypatch.setattr("dechirp.certificate.paper_figures.render_svg", lambda *_, **__: Markup(""))


@nightly
@pytest.mark.usefixtures("without_paper_figures")
def test_json_document_describes_each_claim(run_cli, tmp_path):
    status, out, err = run_cli("--json", "--seed", "3")
    document = json.loads(out)

    assert err == ""
    assert [claim["id"] for claim in document["claims"]] == list(CLAIM_IDS)
    for claim in document["claims"]:
        assert list(claim)[: len(CLAIM_KEYS)] == CLAIM_KEYS
        assert claim["passed"] == all(check["passed"] for check in claim["checks"])
    assert document["passed"] == all(claim["passed"] for claim in document["claims"])
    # Thirty trials do not measure an RMSE to 15 %, so the certificate fails with status 1.
    assert (document["passed"], status) == (False, 1)
    assert (document["seed"], document["version"]) == (3, dc.__version__)
    assert document["claims"] != certificate_as_json_data(default_certificate())["claims"]
    assert json.loads((tmp_path / "dechirp-verify" / "verify.json").read_text()) == document
    assert set(document["files"]) == {path.name for path in (tmp_path / "dechirp-verify").iterdir()}


@nightly
@pytest.mark.usefixtures("without_paper_figures")
def test_terminal_output_shows_failed_claims_and_limits(run_cli, tmp_path, monkeypatch):
    result = default_certificate()
    monkeypatch.setattr(certificate, "verify", lambda **_: result)
    status, out, _ = run_cli("--out", "here")

    assert status == 1
    assert "range_rmse" in out
    assert "FAILS" in out
    assert "required ≤" in out
    assert "claims hold" in out
    assert (tmp_path / "here" / "report.html").exists()


@nightly
@pytest.mark.usefixtures("without_paper_figures")
def test_exit_status_is_zero_when_all_claims_hold(run_cli, monkeypatch):
    result = default_certificate()
    monkeypatch.setattr(
        certificate,
        "verify",
        lambda **_: replace(result, claims=tuple(_make_passing(claim) for claim in result.claims)),
    )
    status, out, err = run_cli("--quiet")
    assert (status, out, err) == (0, "", "")
    status, out, err = run_cli()
    assert status == 0
    assert err.startswith("Testing the claims") and "minutes" in err
    assert f"{len(CLAIM_IDS)} of {len(CLAIM_IDS)} claims hold." in out


def _make_passing(claim):
    no_limits = {"at_least": None, "at_most": None, "low": None, "high": None}
    checks = tuple(replace(check, **no_limits) for check in claim.checks)
    return replace(claim, checks=checks)


@nightly
def test_same_seed_gives_bit_identical_certificate():
    with ThreadPoolExecutor(2) as threads:
        serial, parallel = (
            certificate_as_json_data(default_certificate()),
            certificate_as_json_data(verify(executor=threads)),
        )
    for key in ("date", "timing_s"):
        del serial[key], parallel[key]
    assert repr(serial) == repr(parallel)  # with few trials, some intervals are NaN


@nightly
def test_full_certificate_has_parts_and_progress_counts_all_jobs(monkeypatch):
    # Calibrations take seconds each; a rectangular window has closed forms.
    group = {"maps of noise": every_detector.MAP_GROUPS["maps of noise"][:1]}
    monkeypatch.setattr(every_detector, "MAP_GROUPS", group)
    monkeypatch.setattr(every_detector, "MIN_CELLS", 1e5)
    original_jobs, original_tests = (
        extended.calibration_direction_impairment_jobs,
        false_alarms.planned_noise_tests,
    )
    monkeypatch.setattr(
        extended,
        "calibration_direction_impairment_jobs",
        lambda n_trials: reduce_trials(original_jobs(n_trials)),
    )
    monkeypatch.setattr(
        false_alarms, "planned_noise_tests", lambda full: original_tests(full=False)
    )
    progress_counts = []

    result = verify(
        seed=2, trials=100, full=True, progress=lambda *counts: progress_counts.append(counts)
    )

    document = certificate_as_json_data(result)
    assert [part["id"] for part in document["parts"]] == [
        "false_alarms",
        "directions",
        "impairments",
    ]
    assert all(part["claims"] for part in document["parts"])
    assert not document["passed"]  # too few trials
    assert progress_counts == [
        (n_done, len(progress_counts)) for n_done in range(1, len(progress_counts) + 1)
    ]
    assert {"python", "numpy", "scipy", "numba", "llvmlite"} <= set(document["versions"])
    assert document["checksum"] == checksum_of_numbers(json.loads(to_json_text(document)))


def test_tables_show_published_and_computed_numbers():
    tables = {
        table["number"]: table
        for table in certificate_as_json_data(default_certificate())["tables"]
    }

    assert list(tables) == [5, 6, 7]
    waveform = {row["quantity"]: row for row in tables[6]["rows"]}
    # The report computed with c = 3e8; the exact c gives 0.07 % less and more.
    assert waveform["bandwidth"]["published"] == 150e6
    assert waveform["bandwidth"]["computed"] == pytest.approx(149.896e6, rel=1e-4)
    assert waveform["chirp duration"]["published"] == pytest.approx(7.3333e-6, rel=1e-5)
    assert waveform["slope"]["published"] == 2.045e13


def test_corrections_have_expected_values():
    document = certificate_as_json_data(default_certificate())
    corrections = {correction["subject"]: correction for correction in document["corrections"]}

    assert corrections["residual video phase"]["correct"].startswith("1.138 cycles")
    assert corrections["measured velocity"]["correct"].startswith("11.50 m/s")
    assert corrections["slope of the ramp"]["correct"] == "2.0455e+13 Hz/s"
    assert corrections["samples of a chirp"]["correct"] == "2200"
    assert "28.9" in corrections["amplitudes used as powers"]["correct"]
    assert "16.0 dB" in corrections["amplitudes used as powers"]["reason"]
    assert len(corrections) == 10


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["--trials", "0"], "--trials"),
        (["--trials", "-5"], "--trials"),
        (["--trials", "many"], "--trials"),
        (["--trials", "1.5"], "--trials"),
        (["--trials", "1e9"], "--trials"),
        (["--trials", "100000001"], "--trials"),
        (["--seed", "-1"], "--seed"),
        (["--seed", "x"], "--seed"),
        (["claim"], "claim"),
        (["--fast"], "--fast"),
    ],
    ids=" ".join,
)
def test_rejects_invalid_calls_with_option_name(run_cli, arguments, option):
    status, out, err = run_cli(*arguments)
    assert (status, out) == (2, "")
    assert option in err
    assert "Traceback" not in err
    status, out, _ = run_cli("--json", *arguments)
    assert status == 2
    assert option in str(json.loads(out)["errors"])


def test_rejects_foreign_folder_before_trials(run_cli, tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    monkeypatch.setattr(
        certificate, "_trial_jobs_of_report_claims", lambda *_, **__: pytest.fail("trials started")
    )

    status, _, err = run_cli("--out", "mine")

    assert status == 2
    assert "thesis.txt" in err


def test_help_imports_no_heavy_library(run_cli):
    heavy_libraries = {"numba", "matplotlib", "loky"}
    imported_before = heavy_libraries & set(sys.modules)
    status, out, _ = run_cli("--help")
    assert status == 0
    assert "--full" in out
    assert heavy_libraries & set(sys.modules) == imported_before


@pytest.mark.parametrize(
    "arguments", [{"trials": 0}, {"trials": 2.5}, {"seed": -1}, {"seed": "a"}, {"executor": 3}]
)
def test_verify_function_rejects_invalid_arguments(arguments):
    with pytest.raises(dc.InvalidSetting, match=next(iter(arguments))):
        verify(**arguments)


@nightly
@pytest.mark.parametrize(("signal_number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_verify_exits_quietly_and_writes_nothing(tmp_path, signal_number, status):
    process = subprocess.Popen(
        [sys.executable, "-m", "dechirp", "verify"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Background processes of a shell ignore SIGINT, and their children inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    workers = wait_for_workers(process)
    os.killpg(process.pid, signal_number)  # as a terminal does
    out, err = process.communicate(timeout=120)

    assert (process.returncode, out) == (status, "")
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []
    _, alive = psutil.wait_procs(workers, timeout=20)
    assert [worker for worker in alive if worker.status() != psutil.STATUS_ZOMBIE] == []


def wait_for_workers(process: subprocess.Popen) -> list[psutil.Process]:
    """Return the worker processes of a run once its trials have started, within two minutes."""
    for _ in range(1200):
        assert process.poll() is None, process.communicate()
        children = psutil.Process(process.pid).children(recursive=True)
        if len(children) > 1:
            time.sleep(2)  # into the trials
            return children
        time.sleep(0.1)
    raise TimeoutError("no trial started")
