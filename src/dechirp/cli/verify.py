"""`dechirp verify`: the reference report, claim by claim, and a paper that shows it."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import Json, Pdf, Quiet, Whole, whole_number


def verify(
    *,
    trials: Whole = None,
    full: Annotated[bool, Parameter(show_default=False)] = False,
    out: Path = Path("dechirp-verify"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: Whole = None,
) -> int:
    """Measure every claim of the reference report against theory, and write the paper.

    In full also false alarms of every detector under every window, errors of every direction
    estimator, and every impairment against its formula.

    Ends with status 1 if a claim fails.

    Parameters
    ----------
    trials
        Of each claim on detection, estimates and resolution; one that needs more to decide
        takes what it needs.
    full
        10,000 trials, 1e9 cells of each detector, every part: a quarter of an hour on two cores.
    out
        Folder for the paper and its numbers. Earlier ones in it are replaced.
    seed
        Seed of all noise; 1 without it.
    """
    import dechirp
    from dechirp.cli.show import progress
    from dechirp.experiment.verify.certificate import verify as certify
    from dechirp.experiment.verify.document import document
    from dechirp.report.paper import render
    from dechirp.report.pdf import check_pdf, pdf_of
    from dechirp.store.tables import json_text
    from dechirp.store.texts import check_out, write_files

    n_trials = None if trials is None else whole_number("--trials", trials, 1, 100_000_000)
    start = 1 if seed is None else whole_number("--seed", seed, 0, 2**63 - 1)
    check_out(out, (*_FILES, "report.pdf"))
    if pdf:
        check_pdf()
    names = (*_FILES, "report.pdf") if pdf else _FILES
    with progress("trials", quiet=quiet) as report:
        certificate = certify(trials=n_trials, full=full, seed=start, progress=report)
    found = {
        "version": dechirp.__version__,
        **document(certificate),
        "files": {name: str(out / name) for name in names},
    }
    text = json_text(found)
    page = render(found)
    contents = [text.encode(), page.encode(), *([pdf_of(page)] if pdf else [])]
    write_files(out, dict(zip(names, contents, strict=True)))
    if as_json:
        print(text, end="")
    elif not quiet:
        _show(found, out)
    return 0 if certificate.passed else 1


_FILES = ("verify.json", "report.html")


def _show(found: dict[str, Any], out: Path) -> None:
    from dechirp.cli.show import console, table
    from dechirp.report.amounts import shown

    screen = console()
    claims = table("", left=["claim", ""], right=["published", "measured"])
    for column, width in zip(claims.columns, (None, len("holds")), strict=False):
        column.no_wrap, column.min_width = True, width
    every = [*found["claims"], *(one for part in found["parts"] for one in part["claims"])]
    for claim in every:
        first = shown(claim)
        verdict = "holds" if claim["passed"] else "FAILS"
        claims.add_row(claim["id"], verdict, first.published, first.measured)
    screen.print(claims)
    failed = [
        (claim["id"], check["name"], shown(check))
        for claim in every
        for check in claim["checks"]
        if not check["passed"]
    ]
    for name, what, check in failed:
        interval = f" ({check.interval})" if check.interval else ""
        screen.print(f"{name}, {what}: {check.measured}{interval}, required {check.required}.")
    n_passed = sum(claim["passed"] for claim in every)
    screen.print(f"{n_passed} of {len(every)} claims hold.")
    screen.print(f"Checksum of the numbers: {found['checksum']}", soft_wrap=True)
    screen.print(f"Paper: {out / 'report.html'}", soft_wrap=True)
