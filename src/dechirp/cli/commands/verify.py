"""`dechirp verify`: test of every claim of the reference report, with a paper."""

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import IntegerText, Json, Pdf, Quiet, parse_integer_option
from dechirp.core.errors import InvalidSetting


def verify(
    *,
    trials: IntegerText = None,
    full: Annotated[bool, Parameter(show_default=False)] = False,
    out: Path = Path("dechirp-verify"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: IntegerText = None,
    witnesses: Annotated[bool, Parameter(show_default=False)] = False,
) -> int:
    """Test every claim of the reference report against theory and write the paper.

    With --full, also the false alarms of every detector under every window, the errors of every
    direction estimator, and every impairment against its formula.

    With --witnesses, compare dechirp with published answers of other people instead, from the
    folder in the environment variable DECHIRP_WITNESS_DATA, and write the board.

    The exit status is 1 if a claim or a comparison fails.

    Parameters
    ----------
    trials
        Number of trials of each claim on detection, estimates and resolution; a claim that needs
        more for a decision uses more.
    full
        Use 10,000 trials, 1e9 cells for each detector, and all parts: a quarter of an hour on two
        cores.
    out
        Folder for the paper and its numbers. Existing ones are replaced.
    seed
        Seed of all noise; 1 by default.
    witnesses
        Write the witness board: witnesses.md, its numbers and its figure.
    """
    if witnesses:
        from dechirp.cli.witness_board import write_witness_board

        _refuse_options_beside_witnesses(trials=trials, full=full, pdf=pdf, seed=seed)
        return write_witness_board(out, as_json=as_json, quiet=quiet)
    import dechirp
    from dechirp.certificate.certificate import verify as certify
    from dechirp.certificate.document import certificate_as_json_data
    from dechirp.certificate.paper import render_paper
    from dechirp.cli.console import progress_bar
    from dechirp.report.pdf import check_pdf_available, html_to_pdf
    from dechirp.results.text_files import (
        check_folder_replaceable,
        to_json_text,
        write_files_into_folder,
    )

    n_trials = None if trials is None else parse_integer_option("--trials", trials, 1, 100_000_000)
    first_seed = 1 if seed is None else parse_integer_option("--seed", seed, 0, 2**63 - 1)
    check_folder_replaceable(out, (*_CERTIFICATE_FILES, "report.pdf"))
    if pdf:
        check_pdf_available()
    names = (*_CERTIFICATE_FILES, "report.pdf") if pdf else _CERTIFICATE_FILES
    if not (quiet or as_json):
        print(_DURATION_NOTES[full], file=sys.stderr, flush=True)
    with progress_bar("trials", quiet=quiet) as report:
        certificate = certify(trials=n_trials, full=full, seed=first_seed, progress=report)
    result = {
        "version": dechirp.__version__,
        **certificate_as_json_data(certificate),
        "files": {name: str(out / name) for name in names},
    }
    text = to_json_text(result)
    page = render_paper(result)
    contents = [text.encode(), page.encode(), *([html_to_pdf(page)] if pdf else [])]
    write_files_into_folder(out, dict(zip(names, contents, strict=True)))
    if as_json:
        print(text, end="")
    elif not quiet:
        _print_claim_verdicts(result, out)
    return 0 if certificate.passed else 1


def _refuse_options_beside_witnesses(**options: Any) -> None:
    """Raise `InvalidSetting` for an option of the certificate beside --witnesses."""
    given = [name for name, option in options.items() if option]
    if given:
        raise InvalidSetting(
            "--witnesses",
            value=f"beside --{given[0]}",
            expected="--witnesses with --out, --json or --quiet only",
            fix=f"leave out --{given[0]}, or --witnesses",
        )


_CERTIFICATE_FILES = ("verify.json", "report.html")
_DURATION_NOTES = {
    False: "Testing the claims of the reference report: one and a half minutes on two cores,"
    " a minute more the first time, longer if --trials is large.",
    True: "Testing the claims and all parts: a quarter of an hour on two cores even if --trials is"
    " small, longer if it is large.",
}


def _print_claim_verdicts(document: dict[str, Any], out: Path) -> None:
    from dechirp.cli.console import new_table, open_stdout_console
    from dechirp.report.check_values import format_check_row

    screen = open_stdout_console()
    claims = new_table("", text_columns=["claim", ""], number_columns=["published", "measured"])
    for column, width in zip(claims.columns, (None, len("holds")), strict=False):
        column.no_wrap, column.min_width = True, width
    claim_list = [
        *document["claims"],
        *(claim for part in document["parts"] for claim in part["claims"]),
    ]
    for claim in claim_list:
        first = format_check_row(claim)
        verdict = "holds" if claim["passed"] else "FAILS"
        claims.add_row(claim["id"], verdict, first.published, first.measured)
    screen.print(claims)
    failed = [
        (claim["id"], check["name"], format_check_row(check))
        for claim in claim_list
        for check in claim["checks"]
        if not check["passed"]
    ]
    for name, check_name, check in failed:
        interval = f" ({check.interval})" if check.interval else ""
        screen.print(
            f"{name}, {check_name}: {check.measured}{interval}, required {check.required}."
        )
    n_passed = sum(claim["passed"] for claim in claim_list)
    screen.print(f"{n_passed} of {len(claim_list)} claims hold.")
    screen.print(f"Checksum of the numbers: {document['checksum']}")
    screen.print(f"Paper: {out / 'report.html'}")
