"""All pages of the studio, by their addresses."""

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

from bokeh.document import Document

from dechirp.experiment.scenario import Scenario
from dechirp.studio.page import page
from dechirp.studio.settings import Limits
from dechirp.studio.teach import applications


def pages(
    worker: Executor, *, scenario: Scenario, limits: Limits
) -> dict[str, Callable[[Document], None]]:
    """What fills the document of each: the live page, and the lessons."""
    live = partial(page, worker=worker, scenario=scenario, limits=limits)
    return {"/": live, **applications(worker, limits)}
