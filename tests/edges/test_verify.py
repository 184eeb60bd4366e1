"""`dechirp verify`: what a person reads, what a script reads, and what is refused."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import psutil
import pytest

import dechirp as dc
from dechirp.certificate import certificate, every_detector, extended, false_alarms
from dechirp.certificate.certificate import CLAIM_IDS, verify
from dechirp.certificate.checksum import number_checksum
from dechirp.certificate.document import build_document
from dechirp.certificate.trials import Job
from dechirp.cli.main import main
from dechirp.results.tables import json_text

CLAIM_KEYS = ["id", "claim", "published", "required", "measured", "limit", "passed"]


def few(jobs: dict[str, Job]) -> dict[str, Job]:
    """The same jobs with a hundredth of their trials, too few to certify anything."""
    return {
        name: replace(job, n_trials=max(job.n_trials // 100, 3), block_size=20)
        for name, job in jobs.items()
    }


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Few trials, and no processes."""
    every = certificate._report_jobs
    monkeypatch.setattr(
        certificate, "_report_jobs", lambda *given, **told: few(every(*given, **told))
    )
    usual = certificate.workers_from_executor
    thread = ThreadPoolExecutor(1)
    monkeypatch.setattr(
        certificate, "workers_from_executor", lambda executor: usual(executor or thread)
    )
    yield
    thread.shutdown()


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Call the command line in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def called(*words):
        with pytest.raises(SystemExit) as ended:
            main(["verify", *words])
        return ended.value.code, *capsys.readouterr()

    return called


def test_one_document_says_of_each_claim_what_a_script_needs(call, tmp_path):
    status, out, err = call("--json", "--seed", "3")
    found = json.loads(out)

    assert err == ""
    assert [claim["id"] for claim in found["claims"]] == list(CLAIM_IDS)
    for claim in found["claims"]:
        assert list(claim)[: len(CLAIM_KEYS)] == CLAIM_KEYS
        assert claim["passed"] == all(check["passed"] for check in claim["checks"])
    assert found["passed"] == all(claim["passed"] for claim in found["claims"])
    # Thirty trials show no root mean square to 15 %: the answer is no, and status 1.
    assert (found["passed"], status) == (False, 1)
    assert (found["seed"], found["version"]) == (3, dc.__version__)
    assert json.loads((tmp_path / "dechirp-verify" / "verify.json").read_text()) == found
    assert set(found["files"]) == {path.name for path in (tmp_path / "dechirp-verify").iterdir()}


def test_a_person_reads_which_claim_fails_and_by_how_much(call, tmp_path):
    status, out, _ = call("--out", "here")

    assert status == 1
    assert "range_rmse" in out
    assert "FAILS" in out
    assert "required ≤" in out
    assert "claims hold" in out
    assert (tmp_path / "here" / "report.html").exists()


def test_when_all_hold_the_status_is_zero(call, monkeypatch):
    made = verify(seed=2)
    monkeypatch.setattr(
        certificate,
        "verify",
        lambda **_: replace(made, claims=tuple(_passing(claim) for claim in made.claims)),
    )
    status, out, _ = call("--quiet")
    assert (status, out) == (0, "")
    status, out, _ = call()
    assert status == 0
    assert f"{len(CLAIM_IDS)} of {len(CLAIM_IDS)} claims hold." in out


def _passing(claim):
    sure = {"at_least": None, "at_most": None, "low": None, "high": None}
    checks = tuple(replace(check, **sure) for check in claim.checks)
    return replace(claim, checks=checks)


def test_the_same_seed_gives_the_same_certificate_to_the_bit():
    with ThreadPoolExecutor(2) as crowd:
        one, many = build_document(verify(seed=4)), build_document(verify(seed=4, executor=crowd))
    for changing in ("date", "timing_s"):
        del one[changing], many[changing]
    assert repr(one) == repr(many)  # so few trials leave an interval or two without a number
    assert build_document(verify(seed=5))["claims"] != one["claims"]


def test_in_full_the_parts_come_too_and_progress_counts_all(monkeypatch):
    # Calibrations take seconds each: a rectangular window has closed forms.
    group = {"maps of noise": every_detector.MAP_GROUPS["maps of noise"][:1]}
    monkeypatch.setattr(every_detector, "MAP_GROUPS", group)
    monkeypatch.setattr(every_detector, "MIN_CELLS", 1e5)
    beyond, noise = extended.initial_jobs, false_alarms.noise_tests
    monkeypatch.setattr(extended, "initial_jobs", lambda n_trials: few(beyond(n_trials)))
    monkeypatch.setattr(false_alarms, "noise_tests", lambda full: noise(full=False))
    seen = []

    made = verify(seed=2, trials=100, full=True, progress=lambda *counts: seen.append(counts))

    found = build_document(made)
    assert [part["id"] for part in found["parts"]] == ["false_alarms", "directions", "impairments"]
    assert all(part["claims"] for part in found["parts"])
    assert not found["passed"]  # of so few
    assert seen == [(done, len(seen)) for done in range(1, len(seen) + 1)]
    assert {"python", "numpy", "scipy", "numba", "llvmlite"} <= set(found["versions"])
    assert found["checksum"] == number_checksum(json.loads(json_text(found)))


def test_the_tables_keep_the_report_s_numbers_beside_ours():
    tables = {table["number"]: table for table in build_document(verify())["tables"]}

    assert list(tables) == [5, 6, 7]
    waveform = {row["quantity"]: row for row in tables[6]["rows"]}
    # The report computed with c = 3e8; the exact c gives 0.07 % less and more.
    assert waveform["bandwidth"]["published"] == 150e6
    assert waveform["bandwidth"]["computed"] == pytest.approx(149.896e6, rel=1e-4)
    assert waveform["chirp duration"]["published"] == pytest.approx(7.3333e-6, rel=1e-5)
    assert waveform["slope"]["published"] == 2.045e13


def test_the_corrections_carry_the_right_values():
    found = {one["subject"]: one for one in build_document(verify())["corrections"]}

    assert found["residual video phase"]["correct"].startswith("1.138 cycles")
    assert found["measured velocity"]["correct"].startswith("11.50 m/s")
    assert found["slope of the ramp"]["correct"] == "2.0455e+13 Hz/s"
    assert found["samples of a chirp"]["correct"] == "2200"
    assert "28.9" in found["amplitudes used as powers"]["correct"]
    assert "16.0 dB" in found["amplitudes used as powers"]["reason"]
    assert len(found) == 10


@pytest.mark.parametrize(
    ("words", "option"),
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
def test_a_wrong_call_says_what_is_needed(call, words, option):
    status, out, err = call(*words)
    assert (status, out) == (2, "")
    assert option in err
    assert "Traceback" not in err
    status, out, _ = call("--json", *words)
    assert status == 2
    assert option in str(json.loads(out)["errors"])


def test_somebody_else_s_folder_is_refused_before_the_trials(call, tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    monkeypatch.setattr(
        certificate, "_report_jobs", lambda *_, **__: pytest.fail("trials were begun")
    )

    status, _, err = call("--out", "mine")

    assert status == 2
    assert "thesis.txt" in err


def test_help_imports_nothing_heavy(call):
    heavy = {"numba", "matplotlib", "loky"}
    before = heavy & set(sys.modules)
    status, out, _ = call("--help")
    assert status == 0
    assert "--full" in out
    assert heavy & set(sys.modules) == before


@pytest.mark.parametrize(
    "wrong", [{"trials": 0}, {"trials": 2.5}, {"seed": -1}, {"seed": "a"}, {"executor": 3}]
)
def test_python_is_refused_the_same(wrong):
    with pytest.raises(dc.InvalidSetting, match=next(iter(wrong))):
        verify(**wrong)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_ends_without_a_word_too_many_and_writes_nothing(
    tmp_path, number, status
):
    called = subprocess.Popen(
        [sys.executable, "-m", "dechirp", "verify"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # What a shell starts in the background ignores it, and so would all that it starts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    workers = workers_of(called)
    os.killpg(called.pid, number)  # as a terminal does
    out, err = called.communicate(timeout=120)

    assert (called.returncode, out) == (status, "")
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []
    _, left = psutil.wait_procs(workers, timeout=20)
    assert [one for one in left if one.status() != psutil.STATUS_ZOMBIE] == []


def workers_of(called: subprocess.Popen) -> list[psutil.Process]:
    """Processes of a run, once it has begun its trials; at most two minutes."""
    for _ in range(1200):
        assert called.poll() is None, called.communicate()
        found = psutil.Process(called.pid).children(recursive=True)
        if len(found) > 1:
            time.sleep(2)  # into the trials
            return found
        time.sleep(0.1)
    raise TimeoutError("no trials were begun")
