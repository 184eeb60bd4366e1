"""Runs of several radars: their command-line output and their results folder."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from dechirp.cli.compilation_notice import announced_compilation

if TYPE_CHECKING:
    from dechirp.experiments.run_radars import Kind, RadarsResult
    from dechirp.experiments.scenario import Scenario


def refuse_options_of_single_radars(names: Sequence[str]) -> None:
    """Raise `InvalidSetting` for options that several radars do not have."""
    from dechirp.core.errors import InvalidSetting

    if names:
        raise InvalidSetting(
            names[0],
            value="given for several radars",
            expected="a single radar",
            fix="leave it out, or run one radar: with one --mount for a traffic file, or with radar"
            " in place of radars in a scenario",
        )


def run_several_radars(
    scenario: "Scenario",
    kind: "Kind",
    *,
    source: Path | None,
    out: Path,
    objects: Sequence[Path],
    coding: Mapping[str, str | Path | None],
    as_json: bool,
    quiet: bool,
) -> int:
    """Run several radars, write the results of each and those of all, and print them."""
    if objects:
        _check_has_tracker(scenario)
    from dechirp.cli.console import open_stdout_console, progress_bar, short_finding_paragraphs
    from dechirp.experiments.run_radars import run_radars
    from dechirp.experiments.study.executors import local_workers
    from dechirp.report.radars_page import combine_findings, describe_fused_tracks

    with (
        TemporaryDirectory() as folder,
        announced_compilation(quiet=quiet, marker=(marker := Path(folder) / "announced")),
        local_workers() as workers,
        progress_bar("radars", quiet=quiet) as report,
    ):
        executor = AnnouncingExecutor(workers.executor, quiet=quiet, marker=marker)
        result = run_radars(scenario, kind=kind, executor=executor, progress=report)
    if objects:
        result = _write_fused_tracks(result, objects, coding, source=source, out=out)
    document = write_radars_results(result, source=source, out=out, objects=objects)
    if as_json:
        print(document, end="")
    elif not quiet:
        screen = open_stdout_console()
        for name, radar in result.radars.items():
            screen.print(f"{name}: {radar._display_line().partition(': ')[2]}")
        screen.print(" ".join(describe_fused_tracks(result)))
        page = out / "report.html"
        for paragraph in short_finding_paragraphs(combine_findings(result), report=page):
            screen.print(paragraph)
        for file in objects:
            screen.print(f"Object list: {file}")
        screen.print(f"Report: {page}")
    return 0


def _check_has_tracker(scenario: "Scenario") -> None:
    """Raise `InvalidSetting` for an object list of several radars without fused tracks."""
    from dechirp.core.errors import InvalidSetting

    if scenario.tracker is None:
        raise InvalidSetting(
            "--objects",
            value="given for several radars without a tracker",
            expected="fused tracks, the object list of several radars",
            fix="add a tracker to the scenario, or run one radar",
        )


def _write_fused_tracks(
    result: "RadarsResult",
    files: Sequence[Path],
    coding: Mapping[str, str | Path | None],
    *,
    source: Path | None,
    out: Path,
) -> "RadarsResult":
    """Write the object list of the vehicle to files; return the result with the findings on it."""
    from dechirp.cli.object_files import write_object_files
    from dechirp.core.errors import DechirpError
    from dechirp.experiments.vehicle_tracks import convert_tracks_to_vehicle_axes
    from dechirp.results.object_lists.object_list import object_list

    try:
        findings = write_object_files(
            lambda: object_list(convert_tracks_to_vehicle_axes(result)), files, coding
        )
    except DechirpError:  # a full disk: keep the results of the run
        write_radars_results(result, source=source, out=out)
        raise
    return replace(result, findings=(*result.findings, *findings))


class AnnouncingExecutor(Executor):
    """Executor of calls that announce their compilations; worker processes have no listener.

    All processes compile the same loops at the same time, and one line is enough: the marker is
    that of `announced_compilation`.
    """

    def __init__(self, executor: Executor, *, quiet: bool, marker: Path) -> None:
        self._executor, self._quiet, self._marker = executor, quiet, marker

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call that announces its compilations."""
        return self._executor.submit(
            _call_announced, self._quiet, self._marker, fn, *args, **kwargs
        )


def _call_announced(
    quiet: bool, marker: Path, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
) -> Any:
    with announced_compilation(quiet=quiet, marker=marker):
        return fn(*args, **kwargs)


def write_radars_results(
    result: "RadarsResult", *, source: Path | None, out: Path, objects: Sequence[Path] = ()
) -> str:
    """Write the results of several radars, a folder for each, and return the JSON document."""
    from dechirp.cli.run_document import radars_json_document, write_run_results
    from dechirp.config.dumping import dump_yaml
    from dechirp.core.atomic_files import atomic_folder, encode_utf8_with_escapes
    from dechirp.report.radars_page import render_radars_report
    from dechirp.results.results import check_results_folder_replaceable
    from dechirp.results.text_files import dataset_to_csv, to_json_text

    check_results_folder_replaceable(out)
    yaml = dump_yaml(
        result.scenario, omitted_settings=() if result.scenario.traffic is None else ("n_frames",)
    )
    tables = {"tracks": result.tracks, "traffic": result.objects}
    texts = {"report.html": render_radars_report(result, yaml=yaml), "scenario.yaml": yaml}
    texts |= {
        f"{name}.csv": dataset_to_csv(table) for name, table in tables.items() if table is not None
    }
    files = {name: out / name for name in (*texts, "run.json")}
    files |= {file.name: file for file in objects}
    texts["run.json"] = to_json_text(radars_json_document(result, source=source, files=files))
    with atomic_folder(out) as folder:
        for name, radar in result.radars.items():
            write_run_results(
                radar, source=source, out=folder / name, shown_out=out / name, objects=()
            )
        for name, text in texts.items():
            (folder / name).write_bytes(encode_utf8_with_escapes(text))
    return texts["run.json"]
