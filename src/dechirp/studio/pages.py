"""Pages of the studio by address."""

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

from bokeh.document import Document

from dechirp.experiments.scenario import Scenario
from dechirp.studio.page import build_page
from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.teach import lesson_builders


def page_builders(
    worker: Executor, *, scenario: Scenario, limits: PageLimits
) -> dict[str, Callable[[Document], None]]:
    """Return the builders of the live page and the lessons by address."""
    live_page = partial(build_page, worker=worker, scenario=scenario, limits=limits)
    return {"/": live_page, **lesson_builders(worker, limits)}
