"""`dechirp tune`: search for the settings that optimise an objective."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import IntegerText, Json, Pdf, Quiet, parse_integer_option

if TYPE_CHECKING:
    from dechirp.experiments.tune.run import TuneResult


def tune(
    file: Path,
    /,
    *,
    workers: IntegerText = None,
    scheduler: str | None = None,
    cluster: str | None = None,
    out: Path = Path("dechirp-tune"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: IntegerText = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
) -> int:
    """Search the settings that optimise an objective, and state the confidence of the gain.

    An interrupted search is resumed by the same call. The exit status is 1 if no candidate meets
    the constraints.

    Parameters
    ----------
    file
        Tune file (YAML): settings to search, scenarios and objective.
    workers
        Number of processes on this machine, one per core by default; or workers of the cluster.
    scheduler
        Address of a running Dask scheduler, such as tcp://host:8786.
    cluster
        slurm: start workers as jobs of this cluster.
    out
        Folder for the results and the progress so far.
    seed
        Seed of all trials and of the search; replaces the seed of the file.
    changes
        PATH=VALUE changes a setting of all scenarios before the search, as
        chain.range_window=hamming; may be repeated.
    """
    from dechirp.cli.console import progress_bar
    from dechirp.experiments.study.executors import workers_from_options
    from dechirp.experiments.tune.parsing import load_tune
    from dechirp.experiments.tune.run import run_search
    from dechirp.report.pdf import check_pdf_available
    from dechirp.results.text_files import to_json_text

    n_workers = None if workers is None else parse_integer_option("--workers", workers, 1, 10_000)
    first_seed = None if seed is None else parse_integer_option("--seed", seed, 0, 2**63 - 1)
    if pdf:
        check_pdf_available()
    settings = load_tune(file, changes or [], seed=first_seed)
    _check_tune_folder_replaceable(out)
    with (
        workers_from_options(workers=n_workers, scheduler=scheduler, cluster=cluster) as pool,
        progress_bar("blocks of trials", quiet=quiet) as report,
    ):
        tuned = run_search(settings, out, workers=pool, progress=report)
    document = _write_tune_results(tuned, out, with_pdf=pdf)
    if as_json:
        print(to_json_text(document), end="")
    elif not quiet:
        _print_tune_results(tuned, document, out)
    return 1 if tuned.best is None else 0


def _print_tune_results(tuned: "TuneResult", document: Mapping[str, Any], out: Path) -> None:
    from dechirp.cli.console import finding_paragraphs, new_table, open_stdout_console
    from dechirp.report.tune import compare_initial_and_best_scores, describe_improvement_and_limits

    screen = open_stdout_console()
    rows = new_table("", text_columns=["fresh trials"], number_columns=["as they are", "best"])
    for name, *values in compare_initial_and_best_scores(document):
        rows.add_row(name, *(value for value, _ in values))
        rows.add_row("", *(interval for _, interval in values))
    screen.print(rows)
    screen.print(describe_improvement_and_limits(document))
    if tuned.best is not None:
        for path, text in tuned.candidates[tuned.best.number].settings:
            screen.print(f"  --set '{path}={text}'")
    for paragraph in finding_paragraphs(tuned.findings):
        screen.print(paragraph)
    screen.print(f"Report: {out / 'report.html'}")


def _check_tune_folder_replaceable(out: Path) -> None:
    """Raise `DechirpError` unless the folder is absent, empty or from an earlier search."""
    from dechirp.core.atomic_files import check_output_folder_replaceable
    from dechirp.experiments.study.ledger import LEDGER_FILES
    from dechirp.experiments.study.ledger_reader import LEDGER_NAME

    best = {_best_scenario_file_name(index) for index in range(_MAX_SOURCES)}
    check_output_folder_replaceable(
        out, marker_file=LEDGER_NAME, own_names={*_TUNE_FILES, _PDF_FILE, *best, *LEDGER_FILES}
    )


def _write_tune_results(tuned: "TuneResult", out: Path, *, with_pdf: bool) -> dict[str, Any]:
    """Write the results next to the ledger and return the JSON document."""
    import dechirp
    from dechirp.config.dumping import dump_yaml
    from dechirp.core.atomic_files import write_text_atomically
    from dechirp.experiments.tune.document import tune_result_as_dict
    from dechirp.report.pdf import write_or_remove_pdf
    from dechirp.report.tune import render_tune_page
    from dechirp.results.text_files import to_json_text

    yamls = [] if tuned.best is None else [dump_yaml(scenario) for scenario in tuned.scenarios]
    names = [*_TUNE_FILES, *(_best_scenario_file_name(number) for number in range(len(yamls)))]
    pages = [_PDF_FILE] if with_pdf else []
    result = {
        "version": dechirp.__version__,
        **tune_result_as_dict(tuned),
        "files": {name: str(out / name) for name in [*names, *pages]},
    }
    page = render_tune_page(result, yaml=yamls[0] if yamls else "")
    texts = (to_json_text(result), page, *yamls)
    for name, text in zip(names, texts, strict=True):
        write_text_atomically(out / name, text)
    write_or_remove_pdf(out / _PDF_FILE, page if with_pdf else None)
    for number in range(len(yamls), _MAX_SOURCES):
        (out / _best_scenario_file_name(number)).unlink(missing_ok=True)
    return result


_TUNE_FILES = ("tune.json", "report.html")
_PDF_FILE = "report.pdf"
_MAX_SOURCES = 100


def _best_scenario_file_name(number: int) -> str:
    """Return the file name of a scenario with the best settings."""
    return f"best-{number + 1}.yaml" if number else "best.yaml"
