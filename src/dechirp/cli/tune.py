"""`dechirp tune`: a search for the settings that serve an aim best."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import Json, Pdf, Quiet, Whole, whole_number

if TYPE_CHECKING:
    from dechirp.experiment.tune.run import Tuned


def tune(
    file: Path,
    /,
    *,
    workers: Whole = None,
    scheduler: str | None = None,
    cluster: str | None = None,
    out: Path = Path("dechirp-tune"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: Whole = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
) -> int:
    """Search settings for a stated aim, and say how sure the gain is.

    Picks up where it stopped. Ends with status 1 if nothing keeps the limits of the aim.

    Parameters
    ----------
    file
        What to search, over which scenarios, for which aim (YAML).
    workers
        Processes that try candidates, one a core without it; or workers of the cluster.
    scheduler
        Address of a Dask scheduler that runs, as tcp://host:8786.
    cluster
        slurm: start workers as jobs of this cluster.
    out
        Folder for the results, and for what is done so far.
    seed
        Seed of all trials and of the search, in place of the file's.
    changes
        PATH=VALUE changes a setting of all scenarios before the search, as
        chain.range_window=hamming; may be repeated.
    """
    from dechirp.cli.show import progress
    from dechirp.experiment.study.executors import chosen
    from dechirp.experiment.tune.read import load_tune
    from dechirp.experiment.tune.run import run
    from dechirp.report.pdf import check_pdf
    from dechirp.store.tables import json_text

    n_workers = None if workers is None else whole_number("--workers", workers, 1, 10_000)
    start = None if seed is None else whole_number("--seed", seed, 0, 2**63 - 1)
    if pdf:
        check_pdf()
    asked = load_tune(file, changes or [], seed=start)
    _check_out(out)
    with (
        chosen(workers=n_workers, scheduler=scheduler, cluster=cluster) as pool,
        progress("blocks of trials", quiet=quiet) as report,
    ):
        tuned = run(asked, out, workers=pool, progress=report)
    found = _write(tuned, out, with_pdf=pdf)
    if as_json:
        print(json_text(found), end="")
    elif not quiet:
        _show(tuned, found, out)
    return 1 if tuned.best is None else 0


def _show(tuned: "Tuned", found: Mapping[str, Any], out: Path) -> None:
    from dechirp.cli.show import console, findings, table
    from dechirp.report.tuned import compared, verdict

    screen = console()
    shown = table("", left=["fresh trials"], right=["as they are", "best"])
    for name, *both in compared(found):
        shown.add_row(name, *(value for value, _ in both))
        shown.add_row("", *(interval for _, interval in both))
    screen.print(shown)
    screen.print(verdict(found))
    if tuned.best is not None:
        for path, text in tuned.candidates[tuned.best.number].settings:
            screen.print(f"  --set '{path}={text}'", soft_wrap=True)
    for paragraph in findings(tuned.findings):
        screen.print(paragraph)
    screen.print(f"Report: {out / 'report.html'}", soft_wrap=True)


def _check_out(out: Path) -> None:
    """Raise `DechirpError` unless a folder is absent, empty, or that of an earlier search."""
    from dechirp.experiment.study.ledger import FILES
    from dechirp.experiment.study.record import NAME
    from dechirp.store.whole import must_be_replaceable

    best = {_best(at) for at in range(_MOST_SOURCES)}
    must_be_replaceable(out, mark=NAME, ours={*_FILES, _PDF, *best, *FILES})


def _write(tuned: "Tuned", out: Path, *, with_pdf: bool) -> dict[str, Any]:
    """Write the results beside the record, and give the document that is one of them."""
    import dechirp
    from dechirp.config.texts import dump
    from dechirp.experiment.tune.document import document
    from dechirp.report.pdf import write_pdf
    from dechirp.report.tuned import render
    from dechirp.store.tables import json_text
    from dechirp.store.whole import write_whole

    yamls = [] if tuned.best is None else [dump(one) for one in tuned.scenarios]
    names = [*_FILES, *(_best(at) for at in range(len(yamls)))]
    pages = [_PDF] if with_pdf else []
    found = {
        "version": dechirp.__version__,
        **document(tuned),
        "files": {name: str(out / name) for name in [*names, *pages]},
    }
    page = render(found, yaml=yamls[0] if yamls else "")
    texts = (json_text(found), page, *yamls)
    for name, text in zip(names, texts, strict=True):
        write_whole(out / name, text)
    write_pdf(out / _PDF, page if with_pdf else None)
    for at in range(len(yamls), _MOST_SOURCES):
        (out / _best(at)).unlink(missing_ok=True)
    return found


_FILES = ("tune.json", "report.html")
_PDF = "report.pdf"
_MOST_SOURCES = 100


def _best(number: int) -> str:
    """File of the scenario of that source under the best settings."""
    return f"best-{number + 1}.yaml" if number else "best.yaml"
