"""Options that several commands take."""

from typing import Annotated, TypeAlias

from cyclopts import Parameter

Json: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--json",
        show_default=False,
        help="Print one JSON document, and nothing else, on standard output.",
    ),
]
Quiet: TypeAlias = Annotated[
    bool, Parameter(name="--quiet", show_default=False, help="Print nothing but mistakes.")
]
