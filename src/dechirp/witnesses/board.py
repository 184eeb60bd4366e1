"""The board: all witnesses run, as a table, with a figure."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dechirp.core.errors import InvalidSetting
from dechirp.core.text import MINUS_SIGN
from dechirp.core.values import frozen_dataclass
from dechirp.witnesses.base import Comparison, Witness

DATA_VARIABLE = "DECHIRP_WITNESS_DATA"


@frozen_dataclass
class Testimony:
    """Comparisons of one witness; none, with the reason, if its files are missing or fail."""

    name: str
    source: str
    licence: str
    comparisons: tuple[Comparison, ...] = ()
    missing: str = ""
    """What is missing; empty if the files are there."""
    error: str = ""
    """Message of the error that ended the comparison; empty if none did."""

    @property
    def passed(self) -> bool:
        """True if no comparison fails."""
        return not self.error and all(comparison.passed for comparison in self.comparisons)


def find_witness_data() -> Path:
    """Return the folder that `DECHIRP_WITNESS_DATA` names.

    Raises
    ------
    InvalidSetting
        If it names none.
    """
    text = os.environ.get(DATA_VARIABLE, "")
    if not text or not Path(text).is_dir():
        raise InvalidSetting(
            DATA_VARIABLE,
            value=text or "not set",
            expected="the folder of the witnesses, with a folder of files for each",
            fix=f"export {DATA_VARIABLE}=FOLDER; the guide's page on the witness board says where"
            " the files come from",
        )
    return Path(text)


def run_witnesses(
    data: Path, *, progress: Callable[[int, int], None] | None = None
) -> tuple[Testimony, ...]:
    """Compare every witness whose files are below `data`; report the others as missing.

    `progress` is called with the number of finished witnesses and of all.
    """
    members = Witness.members()
    testimonies = []
    for number, witness in enumerate(members.values()):
        if progress is not None:
            progress(number, len(members))
        testimonies.append(_hear_witness(witness(), data))
    if progress is not None:
        progress(len(members), len(members))
    return tuple(testimonies)


def _hear_witness(witness: Witness, data: Path) -> Testimony:
    comparisons: list[Comparison] = []
    missing, failure = "", ""
    folder = data / witness.folder
    if not folder.is_dir():
        missing = f"folder {witness.folder}"
    else:
        try:
            comparisons.extend(witness.compare(folder))
        except (FileNotFoundError, ModuleNotFoundError) as error:
            missing = str(error)
        except Exception as error:  # one broken witness must not hide the others
            failure = f"{type(error).__name__}: {error}"
    return Testimony(
        name=witness.kind(),
        source=witness.source,
        licence=witness.licence,
        comparisons=tuple(comparisons),
        missing=missing,
        error=failure,
    )


@frozen_dataclass
class BoardCounts:
    """Numbers of one kind of answer, and the witnesses that they come from."""

    n_numbers: int
    n_passed: int
    n_witnesses: int


def count_answers(testimonies: tuple[Testimony, ...], answer: str) -> BoardCounts:
    """Count the numbers whose answers are `independent` or `own`; see `Comparison.answer`."""
    kept = [
        [item for item in testimony.comparisons if item.answer == answer]
        for testimony in testimonies
    ]
    return BoardCounts(
        n_numbers=sum(map(len, kept)),
        n_passed=sum(item.passed for items in kept for item in items),
        n_witnesses=sum(bool(items) for items in kept),
    )


def summarise_board(testimonies: tuple[Testimony, ...]) -> str:
    """Return one sentence for each kind of answer, and one on sets that are missing or failed."""
    independent, own = (count_answers(testimonies, answer) for answer in ("independent", "own"))
    sentences = [
        f"{independent.n_passed} of {independent.n_numbers} independent answers agree, from"
        f" {independent.n_witnesses} of {len(testimonies)} witnesses.",
        f"{own.n_passed} of {own.n_numbers} answers of our own decoding agree.",
    ]
    for title, names in (
        ("Missing", [testimony.name for testimony in testimonies if testimony.missing]),
        ("Ended by an error", [testimony.name for testimony in testimonies if testimony.error]),
    ):
        if names:
            sentences.append(f"{title}, at least in part: {', '.join(names)}.")
    return " ".join(sentences)


def board_document(testimonies: tuple[Testimony, ...]) -> dict[str, Any]:
    """Return the board as JSON data."""
    comparisons = [item for testimony in testimonies for item in testimony.comparisons]
    return {
        "n_witnesses": sum(bool(testimony.comparisons) for testimony in testimonies),
        "n_numbers": len(comparisons),
        "n_passed": sum(comparison.passed for comparison in comparisons),
        "n_independent": count_answers(testimonies, "independent").n_numbers,
        "n_independent_passed": count_answers(testimonies, "independent").n_passed,
        "n_independent_witnesses": count_answers(testimonies, "independent").n_witnesses,
        "missing": [testimony.name for testimony in testimonies if testimony.missing],
        "summary": summarise_board(testimonies),
        "passed": all(testimony.passed for testimony in testimonies),
        "witnesses": [
            {
                "name": testimony.name,
                "source": testimony.source,
                "licence": testimony.licence,
                "missing": testimony.missing,
                "error": testimony.error,
                "numbers": [
                    {
                        "quantity": comparison.quantity,
                        "answer": comparison.answer,
                        "theirs": comparison.theirs,
                        "ours": comparison.ours,
                        "unit": comparison.unit,
                        "relation": comparison.relation,
                        "tolerance": comparison.tolerance,
                        "basis": comparison.basis,
                        "cause": comparison.cause,
                        "passed": comparison.passed,
                    }
                    for comparison in testimony.comparisons
                ],
            }
            for testimony in testimonies
        ],
    }


def board_as_markdown(testimonies: tuple[Testimony, ...]) -> str:
    """Return the board in Markdown: a table for each witness, one row for each number.

    Name, source and licence precede each table. The summary follows the last one.
    """
    lines = []
    for testimony in testimonies:
        lines += [f"`{testimony.name}`: {testimony.source}. Licence: {testimony.licence}.", ""]
        if testimony.comparisons:
            lines += ["| Quantity | Theirs | Ours | Tolerance | Result |", "|---|---|---|---|---|"]
        for comparison in testimony.comparisons:
            quantity, answer, theirs, *others = format_comparison(comparison)
            theirs = f"own: {theirs}" if answer == "own" else theirs
            lines.append(f"| {' | '.join([quantity, theirs, *others])} |")
        lines += [""] * bool(testimony.comparisons)
        if testimony.missing or testimony.error:
            outcome = f"Missing: {testimony.missing}" if testimony.missing else testimony.error
            lines += [f"{outcome}.", ""]
    return "\n".join([*lines, summarise_board(testimonies)]) + "\n"


def format_comparison(comparison: Comparison) -> tuple[str, str, str, str, str, str]:
    """Return quantity, answer, theirs, ours, tolerance with its basis, and result, as text."""
    unit = "" if comparison.unit == "1" else f" {comparison.unit}"
    bound = "" if comparison.relation == "equal" else f"{comparison.relation} "
    result = "passed" if comparison.passed else f"fails: {comparison.cause or 'cause unknown'}"
    return (
        comparison.quantity,
        comparison.answer,
        f"{bound}{_format_digits(comparison.theirs, 7)}{unit}",
        f"{_format_digits(comparison.ours, 7)}{unit}",
        f"{_format_digits(comparison.tolerance, 2)}{unit}: {comparison.basis}",
        result,
    )


def _format_digits(amount: float, digits: int) -> str:
    """Write significant digits, with an exponent where numbers are small or large."""
    return f"{amount:.{digits}g}".replace("-", MINUS_SIGN)
