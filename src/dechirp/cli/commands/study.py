"""`dechirp study`: Monte Carlo trials over swept settings, with intervals and theory."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import IntegerText, Json, Pdf, Quiet, parse_integer_option

if TYPE_CHECKING:
    from dechirp.experiments.study.ledger import Ledger
    from dechirp.experiments.study.plan import Plan
    from dechirp.experiments.study.run import ReplayedTrial, StudyOutcome
    from dechirp.experiments.study.study import Study


def study(
    file: Path,
    /,
    *,
    workers: IntegerText = None,
    scheduler: str | None = None,
    cluster: str | None = None,
    trial: IntegerText = None,
    out: Path = Path("dechirp-study"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: IntegerText = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
) -> int:
    """Run Monte Carlo trials over swept settings and compare the results with theory.

    An interrupted study is resumed by the same call. The exit status is 1 unless every
    requirement of the file is met with the required confidence.

    Parameters
    ----------
    file
        Study file (YAML): swept settings, number of trials and requirements.
    workers
        Number of processes on this machine, one per core by default; or workers of the cluster.
    scheduler
        Address of a running Dask scheduler, such as tcp://host:8786.
    cluster
        slurm: start workers as jobs of this cluster.
    trial
        Replay this one trial and report it as `dechirp run` does; --set selects the point.
    out
        Folder for the results and the progress so far; dechirp-trial for one trial.
    seed
        Seed of all trials; replaces the seed of the file.
    changes
        PATH=VALUE changes a setting of the scenario, or fixes a swept setting to one value; may
        be repeated.
    """
    from dechirp.cli.study_output import show_live_progress
    from dechirp.experiments.study.executors import workers_from_options
    from dechirp.experiments.study.parsing import load_study
    from dechirp.experiments.study.plan import Plan
    from dechirp.experiments.study.run import (
        create_or_continue_ledger,
        estimate_and_judge_study,
        run_missing_trials,
    )
    from dechirp.experiments.study.trial import score_column_layout_of_study
    from dechirp.report.pdf import check_pdf_available

    n_workers = None if workers is None else parse_integer_option("--workers", workers, 1, 10_000)
    first_seed = None if seed is None else parse_integer_option("--seed", seed, 0, 2**63 - 1)
    number = None if trial is None else parse_integer_option("--trial", trial, 0, 2**53)
    if pdf:
        check_pdf_available()
    settings = load_study(file, changes or [], seed=first_seed)
    if number is not None:
        folder = Path("dechirp-trial") if out == Path("dechirp-study") else out
        return _replay_trial(settings, number, folder, with_pdf=pdf, as_json=as_json, quiet=quiet)
    _check_study_folder_replaceable(out)
    plan = Plan.from_study(settings)
    with ExitStack() as resources:
        with workers_from_options(workers=n_workers, scheduler=scheduler, cluster=cluster) as pool:
            ledger = resources.enter_context(create_or_continue_ledger(settings, out))
            if settings.keep and not (quiet or as_json):
                _print_max_data_set_size(plan)
            with show_live_progress(
                plan, score_column_layout_of_study(plan), ledger, quiet=quiet
            ) as on_progress:
                run_missing_trials(plan, ledger, pool, on_progress)
        outcome = estimate_and_judge_study(plan, ledger)
        text = _write_study_results(outcome, ledger, file, out, with_pdf=pdf)
    if as_json:
        print(text, end="")
    elif not quiet:
        _print_study_results(outcome, [*pool.findings, *outcome.environment_findings], out)
    from dechirp.experiments.study.requirements import exit_status

    return exit_status(outcome.verdicts)


def _check_study_folder_replaceable(out: Path) -> None:
    """Raise `DechirpError` unless the folder is absent, empty or from an earlier study."""
    from dechirp.core.atomic_files import check_output_folder_replaceable
    from dechirp.experiments.study.ledger import LEDGER_FILES
    from dechirp.experiments.study.ledger_reader import LEDGER_NAME
    from dechirp.results.table_files import TABLE_SUFFIXES

    check_output_folder_replaceable(
        out,
        marker_file=LEDGER_NAME,
        own_names={
            *_STUDY_FILES,
            *(name + suffix for name in _TABLES for suffix in TABLE_SUFFIXES),
            *LEDGER_FILES,
            *_DATA_SET_FILES,
            *_PDF_FILES,
        },
    )


_STUDY_FILES = ("report.html", "study.yaml", "study.json")
_TABLES = ("points", "trials")
_DATA_SET_FILES = ("data.zarr", "datasheet.html")
_PDF_FILES = ("report.pdf", "datasheet.pdf")


def _print_max_data_set_size(plan: "Plan") -> None:
    """Print the largest possible size of the data set before the trials start."""
    from dechirp.cli.console import open_stdout_console
    from dechirp.experiments.study.data_set import format_bytes, uncompressed_data_set_bytes

    n_items = plan.n_points * plan.study.trials.at_most
    open_stdout_console().print(
        f"Data set: at most {n_items} items, {format_bytes(uncompressed_data_set_bytes(plan))} of"
        " samples and maps before compression."
    )


def _write_study_results(
    outcome: "StudyOutcome", ledger: "Ledger", source: Path, out: Path, *, with_pdf: bool
) -> str:
    """Write the results next to the ledger and return the JSON document."""
    import datetime

    import dechirp
    from dechirp.cli.study_output import study_json_document
    from dechirp.core.atomic_files import write_text_atomically
    from dechirp.experiments.study.dumping import dump_study_as_yaml
    from dechirp.experiments.study.ledger_reader import LEDGER_NAME
    from dechirp.experiments.study.results import (
        iter_trial_numbers_and_sums,
        write_points_table,
        write_trials_table,
    )
    from dechirp.report.pdf import write_or_remove_pdf
    from dechirp.report.study.page import StudyOrigin, render_study_page
    from dechirp.results.table_files import TABLE_SUFFIXES, available_table_suffix
    from dechirp.results.text_files import to_json_text

    study = outcome.result.study
    data_set = _DATA_SET_FILES if study.keep else ()
    pdfs = _PDF_FILES[: 2 if study.keep else 1] if with_pdf else ()
    yaml = dump_study_as_yaml(study)
    metadata = {"dechirp": dechirp.__version__, "study": yaml}
    suffix = available_table_suffix()
    write_points_table(outcome.result, out / f"points{suffix}", metadata=metadata)
    write_trials_table(
        outcome.result.layout,
        iter_trial_numbers_and_sums(ledger),
        out / f"trials{suffix}",
        metadata=metadata,
    )
    # Tables of an earlier call, with or without the extra, would contradict these.
    for other in {*TABLE_SUFFIXES} - {suffix}:
        for name in _TABLES:
            (out / f"{name}{other}").unlink(missing_ok=True)
    tables = (f"{name}{suffix}" for name in _TABLES)
    names = (*_STUDY_FILES, *tables, LEDGER_NAME, *data_set, *pdfs)
    n_trials = int(outcome.result.trials.sum())
    text = to_json_text(
        study_json_document(
            outcome.result,
            outcome.verdicts,
            version=dechirp.__version__,
            n_done=n_trials,
            n_total=n_trials,
            files={name: out / name for name in names},
        )
    )
    page = render_study_page(
        outcome.result,
        outcome.verdicts,
        yaml=yaml,
        points_file=f"points{suffix}",
        origin=StudyOrigin(
            date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            source=str(source),
            digests=tuple(_names_and_sha256_of_inputs(source, ledger.study_identity)),
            environments=tuple(ledger.environments_of_all_runs),
            seconds=ledger.total_computing_seconds(),
        ),
    )
    texts = {"study.yaml": yaml, "study.json": text, "report.html": page}
    if data_set:
        texts["datasheet.html"] = _render_data_set_datasheet(study, out)
    for name, content in texts.items():
        write_text_atomically(out / name, content)
    for name in _PDF_FILES:
        html = texts.get(name.replace(".pdf", ".html"))
        write_or_remove_pdf(out / name, html if with_pdf else None)
    return text


def _render_data_set_datasheet(study: "Study", out: Path) -> str:
    from dechirp.report.data_set import render_data_set_page
    from dechirp.results.data_set import folder_size_bytes, open_data_set_groups

    folder = out / "data.zarr"
    data = open_data_set_groups(folder)
    return render_data_set_page(study, data, n_bytes=folder_size_bytes(folder))


def _names_and_sha256_of_inputs(
    source: Path, identity: dict[str, str]
) -> Sequence[tuple[str, str]]:
    """Return the SHA-256 of the study file, of the resolved study and of the files it names."""
    import hashlib

    run = "".join(identity[part] for part in ("study", "scenario"))
    named_files = [
        (key.removeprefix("file "), sum_) for key, sum_ in identity.items() if "file " in key
    ]
    return [
        (str(source), hashlib.sha256(source.read_bytes()).hexdigest()),
        ("resolved study and scenario", hashlib.sha256(run.encode()).hexdigest()),
        *named_files,
    ]


def _print_study_results(outcome: "StudyOutcome", shown_findings: Sequence[Any], out: Path) -> None:
    from dechirp.cli.console import finding_paragraphs, open_stdout_console
    from dechirp.cli.study_output import (
        omitted_point_count_line,
        requirement_paragraphs,
        study_points_table,
    )
    from dechirp.results.table_files import available_table_suffix

    screen = open_stdout_console()
    screen.print(study_points_table(outcome.result, width=screen.width))
    suffix = available_table_suffix()
    for line in omitted_point_count_line(outcome.result, f"points{suffix}"):
        screen.print(line)
    for paragraph in requirement_paragraphs(outcome.verdicts, outcome.result):
        screen.print(paragraph)
    point_findings = dict.fromkeys(finding for _, finding in outcome.result.findings)
    for paragraph in finding_paragraphs([*shown_findings, *point_findings]):
        screen.print(paragraph)
    n_failed = len(outcome.result.failures)
    if n_failed:
        screen.print(f"{n_failed} trials failed; the report names them.")
    if suffix == ".csv":
        screen.print(
            "Points and trials are CSV files; for Parquet files, run pip install"
            " 'dechirp[parquet]' and repeat the command.",
            markup=False,
        )
    screen.print(f"Report: {out / 'report.html'}")
    if outcome.result.study.keep:
        screen.print(f"Data set: {out / 'data.zarr'}, {out / 'datasheet.html'}")


def _replay_trial(
    study: "Study", trial: int, out: Path, *, with_pdf: bool, as_json: bool, quiet: bool
) -> int:
    """Run one trial alone, and show it as `dechirp run` does."""
    from dechirp.cli.commands.run import print_run_results
    from dechirp.cli.run_document import write_run_results
    from dechirp.core.errors import InvalidSetting
    from dechirp.experiments.study.plan import Plan
    from dechirp.experiments.study.run import replay_trial
    from dechirp.results.results import check_results_folder_replaceable
    from dechirp.results.text_files import to_json_text

    plan = Plan.from_study(study)
    if plan.n_points != 1:
        varied_paths = [axis.path for axis in plan.swept_settings if len(axis.texts) > 1]
        raise InvalidSetting(
            "--trial",
            value=f"used with {plan.n_points} points",
            expected="one point",
            fix="select it with " + " ".join(f"--set {path}=VALUE" for path in varied_paths),
        )
    check_results_folder_replaceable(out)
    replay_result = replay_trial(study, trial)
    text = write_run_results(
        replay_result.result, source=None, out=out, objects=(), with_pdf=with_pdf
    )
    if as_json:
        print(to_json_text(_replayed_trial_document(replay_result, plan, text)), end="")
    elif not quiet:
        print_run_results(replay_result.result, out, ())
    return 0


def _replayed_trial_document(replay: "ReplayedTrial", plan: Any, run_json: str) -> dict[str, Any]:
    """Return the document of a run with the contribution of the trial to each score."""
    import json

    from dechirp.experiments.study.trial import score_column_layout_of_study

    layout = score_column_layout_of_study(plan)
    sums = {
        score.kind(): {
            name or "all": layout.select_score_sums(replay.sums[None], score.kind(), name)[
                0
            ].tolist()
            for name in (layout.scored_target_names[layout.index_of_score(score.kind())] or (None,))
        }
        for score in layout.scores
    }
    return {**json.loads(run_json), "trial": replay.trial, "sums": sums}
