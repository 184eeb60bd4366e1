"""`dechirp study`: trials over varied settings, with intervals, beside theory."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import Json, Pdf, Quiet, Whole, whole_number

if TYPE_CHECKING:
    from dechirp.experiment.study.ledger import Ledger
    from dechirp.experiment.study.plan import Plan
    from dechirp.experiment.study.run import Finished, Replayed
    from dechirp.experiment.study.study import Study


def study(
    file: Path,
    /,
    *,
    workers: Whole = None,
    scheduler: str | None = None,
    cluster: str | None = None,
    trial: Whole = None,
    out: Path = Path("dechirp-study"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: Whole = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
) -> int:
    """Try a scenario many times over varied settings, and compare with theory.

    Goes on where an earlier call ended. Ends with status 1 unless all that the file requires is
    shown to be met.

    Parameters
    ----------
    file
        What is varied, how often it is tried, and what is required (YAML).
    workers
        Processes of this machine, one a core without it; or workers of the cluster.
    scheduler
        Address of a Dask scheduler that runs, as tcp://host:8786.
    cluster
        slurm: start workers as jobs of this cluster.
    trial
        Replay this one trial instead, as `dechirp run` shows one; --set chooses the point.
    out
        Folder for the results, and for what is done so far; dechirp-trial for one trial.
    seed
        Seed of all trials, in place of the file's.
    changes
        PATH=VALUE changes a setting of the scenario, or keeps one value of what is varied; may
        be repeated.
    """
    from dechirp.cli.studied import live
    from dechirp.experiment.study.executors import chosen
    from dechirp.experiment.study.plan import Plan
    from dechirp.experiment.study.read import load_study
    from dechirp.experiment.study.run import finished, open_ledger, run_trials
    from dechirp.experiment.study.trial import layout_of
    from dechirp.report.pdf import check_pdf

    n_workers = None if workers is None else whole_number("--workers", workers, 1, 10_000)
    start = None if seed is None else whole_number("--seed", seed, 0, 2**63 - 1)
    number = None if trial is None else whole_number("--trial", trial, 0, 2**53)
    if pdf:
        check_pdf()
    asked = load_study(file, changes or [], seed=start)
    if number is not None:
        folder = Path("dechirp-trial") if out == Path("dechirp-study") else out
        return _replay(asked, number, folder, with_pdf=pdf, as_json=as_json, quiet=quiet)
    _check_out(out)
    plan = Plan.of(asked)
    with ExitStack() as kept_open:
        with chosen(workers=n_workers, scheduler=scheduler, cluster=cluster) as pool:
            ledger = kept_open.enter_context(open_ledger(asked, out))
            if asked.keep and not (quiet or as_json):
                _tell_size(plan)
            with live(plan, layout_of(plan), ledger, quiet=quiet) as tell:
                run_trials(plan, ledger, pool, tell)
        made = finished(plan, ledger)
        text = _write(made, ledger, file, out, with_pdf=pdf)
    if as_json:
        print(text, end="")
    elif not quiet:
        _show(made, [*pool.findings, *made.doubts], out)
    from dechirp.experiment.study.require import exit_status

    return exit_status(made.judged)


def _check_out(out: Path) -> None:
    """Raise `DechirpError` unless a folder is absent, empty, or that of an earlier study."""
    from dechirp.experiment.study.ledger import FILES
    from dechirp.experiment.study.record import NAME
    from dechirp.store.whole import must_be_replaceable

    must_be_replaceable(out, mark=NAME, ours={*_FILES, *FILES, *_OF_DATA_SETS, *_PDFS})


_FILES = ("report.html", "study.yaml", "study.json", "points.parquet", "trials.parquet")
_OF_DATA_SETS = ("data.zarr", "datasheet.html")
_PDFS = ("report.pdf", "datasheet.pdf")


def _tell_size(plan: "Plan") -> None:
    """Say before the trials how large their data set may become."""
    from dechirp.cli.show import console
    from dechirp.experiment.study.data_set import data_bytes, in_gigabytes

    n_items = plan.n_points * plan.study.trials.at_most
    console().print(
        f"Data set: at most {n_items} items, {in_gigabytes(data_bytes(plan))} of samples and maps"
        " before they are packed."
    )


def _write(made: "Finished", ledger: "Ledger", source: Path, out: Path, *, with_pdf: bool) -> str:
    """Write the results beside the record, and give the JSON document that is one of them."""
    import datetime

    import dechirp
    from dechirp.cli.studied import document
    from dechirp.experiment.study.record import NAME
    from dechirp.experiment.study.results import numbered, write_points, write_trials
    from dechirp.experiment.study.text import study_text
    from dechirp.report.pdf import write_pdf
    from dechirp.report.study import Made, render
    from dechirp.store.tables import json_text
    from dechirp.store.whole import write_whole

    asked = made.result.study
    data_set = _OF_DATA_SETS if asked.keep else ()
    pdfs = _PDFS[: 2 if asked.keep else 1] if with_pdf else ()
    yaml = study_text(asked)
    about = {"dechirp": dechirp.__version__, "study": yaml}
    write_points(made.result, out / "points.parquet", about=about)
    write_trials(made.result.layout, numbered(ledger), out / "trials.parquet", about=about)
    done = int(made.result.trials.sum())
    text = json_text(
        document(
            made.result,
            made.judged,
            version=dechirp.__version__,
            done=done,
            total=done,
            files={name: out / name for name in (*_FILES, NAME, *data_set, *pdfs)},
        )
    )
    page = render(
        made.result,
        made.judged,
        yaml=yaml,
        made=Made(
            date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            source=str(source),
            digests=tuple(_digests(source, ledger.identity)),
            environments=tuple(ledger.environments),
            seconds=ledger.seconds(),
        ),
    )
    texts = {"study.yaml": yaml, "study.json": text, "report.html": page}
    if data_set:
        texts["datasheet.html"] = _datasheet(asked, out)
    for name, content in texts.items():
        write_whole(out / name, content)
    for name in _PDFS:
        html = texts.get(name.replace(".pdf", ".html"))
        write_pdf(out / name, html if with_pdf else None)
    return text


def _datasheet(study: "Study", out: Path) -> str:
    from dechirp.report.data_set import render
    from dechirp.store.data_set import n_bytes, read_data_set

    folder = out / "data.zarr"
    return render(study, read_data_set(folder), n_bytes=n_bytes(folder))


def _digests(source: Path, identity: dict[str, str]) -> Sequence[tuple[str, str]]:
    """SHA-256 of the study file, of the study as run, and of the files that it names."""
    import hashlib

    run = "".join(identity[part] for part in ("study", "scenario"))
    named = [(key.removeprefix("file "), sum_) for key, sum_ in identity.items() if "file " in key]
    return [
        (str(source), hashlib.sha256(source.read_bytes()).hexdigest()),
        ("the study and its scenario as run", hashlib.sha256(run.encode()).hexdigest()),
        *named,
    ]


def _show(made: "Finished", said: Sequence[Any], out: Path) -> None:
    from dechirp.cli.show import console, findings
    from dechirp.cli.studied import more, points, requirements

    screen = console()
    screen.print(points(made.result, width=screen.width))
    for line in more(made.result):
        screen.print(line)
    for paragraph in requirements(made.judged, made.result):
        screen.print(paragraph)
    told = dict.fromkeys(finding for _, finding in made.result.findings)
    for paragraph in findings([*said, *told]):
        screen.print(paragraph)
    n_failed = len(made.result.failures)
    if n_failed:
        screen.print(f"{n_failed} trials failed; the report names them.")
    screen.print(f"Report: {out / 'report.html'}", soft_wrap=True)
    if made.result.study.keep:
        screen.print(f"Data set: {out / 'data.zarr'}, {out / 'datasheet.html'}", soft_wrap=True)


def _replay(
    asked: "Study", trial: int, out: Path, *, with_pdf: bool, as_json: bool, quiet: bool
) -> int:
    """Run one trial alone, and show it as `dechirp run` does."""
    from dechirp.cli.run import show, write
    from dechirp.core.errors import InvalidSetting
    from dechirp.experiment.study.plan import Plan
    from dechirp.experiment.study.run import replay
    from dechirp.store.results import check_out
    from dechirp.store.tables import json_text

    plan = Plan.of(asked)
    if plan.n_points != 1:
        varied = [axis.path for axis in plan.axes if len(axis.texts) > 1]
        raise InvalidSetting(
            "--trial",
            got=f"given for {plan.n_points} points",
            need="one point",
            fix="Choose it: " + " ".join(f"--set {path}=VALUE" for path in varied) + ".",
        )
    check_out(out)
    made = replay(asked, trial)
    text = write(made.result, source=None, out=out, objects=(), with_pdf=with_pdf)
    if as_json:
        print(json_text(_replayed(made, plan, text)), end="")
    elif not quiet:
        show(made.result, out, ())
    return 0


def _replayed(made: "Replayed", plan: Any, text: str) -> dict[str, Any]:
    """The document of a run, with what the trial adds to each score."""
    import json

    from dechirp.experiment.study.trial import layout_of

    layout = layout_of(plan)
    sums = {
        score.label(): {
            name or "all": layout.sums_of(made.sums[None], score.label(), name)[0].tolist()
            for name in (layout.subjects[layout.index(score.label())] or (None,))
        }
        for score in layout.scores
    }
    return {**json.loads(text), "trial": made.trial, "sums": sums}
