"""Interactive lessons on the four phases of the reference report."""

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

from bokeh.document import Document

from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.teach.chirp import ChirpLesson
from dechirp.studio.teach.doppler import DopplerLesson
from dechirp.studio.teach.echo import EchoLesson
from dechirp.studio.teach.noise import NoiseLesson
from dechirp.studio.teach.page import LessonPage

LESSONS = (ChirpLesson, EchoLesson, DopplerLesson, NoiseLesson)
"""In the order of the report."""


def lesson_page_builders_by_address(
    worker: Executor, limits: PageLimits
) -> dict[str, Callable[[Document], None]]:
    """Return the page builder of each lesson by address."""

    def build(document: Document, number: int) -> None:
        LessonPage(
            document,
            make=LESSONS[number - 1],
            number=number,
            n_lessons=len(LESSONS),
            worker=worker,
            limits=limits,
        )

    return {
        f"/teach/{number}": partial(build, number=number) for number in range(1, len(LESSONS) + 1)
    }
