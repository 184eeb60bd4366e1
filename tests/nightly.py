"""Marks of long tests and of further cases, which run if DECHIRP_NIGHTLY is set."""

import os
from collections.abc import Container, Iterable

import pytest

NIGHTLY = bool(os.environ.get("DECHIRP_NIGHTLY"))
RUN_HINT = "run with DECHIRP_NIGHTLY=1"
nightly = pytest.mark.skipif(not NIGHTLY, reason=f"long tests: {RUN_HINT}")

_PARAMETERS = type(pytest.param())


def n_examples(n: int) -> int:
    """Return the number of examples of a property: a tenth of the nightly number by default."""
    return n if NIGHTLY else n // 10


def nightly_except(kept: int | Container, cases: Iterable) -> list:
    """Return cases of a parametrisation, nightly except the first ones or those that are kept.

    As for pytest, a tuple has the values of several parameters.
    """
    marked = []
    for number, case in enumerate(cases):
        if number < kept if isinstance(kept, int) else case in kept:
            marked.append(case)
        elif isinstance(case, _PARAMETERS):
            marked.append(pytest.param(*case.values, marks=(*case.marks, nightly), id=case.id))
        else:
            marked.append(
                pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=nightly)
            )
    return marked
