"""The four phases of the reference report, as pages to play with."""

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

from bokeh.document import Document

from dechirp.studio.settings import Limits
from dechirp.studio.teach.chirp import ChirpLesson
from dechirp.studio.teach.doppler import DopplerLesson
from dechirp.studio.teach.echo import EchoLesson
from dechirp.studio.teach.noise import NoiseLesson
from dechirp.studio.teach.page import LessonPage

LESSONS = (ChirpLesson, EchoLesson, DopplerLesson, NoiseLesson)
"""In the order of the report."""


def applications(worker: Executor, limits: Limits) -> dict[str, Callable[[Document], None]]:
    """What makes the page of each lesson, by its address."""

    def made(document: Document, number: int) -> None:
        LessonPage(
            document,
            make=LESSONS[number - 1],
            number=number,
            n_lessons=len(LESSONS),
            worker=worker,
            limits=limits,
        )

    return {
        f"/teach/{number}": partial(made, number=number) for number in range(1, len(LESSONS) + 1)
    }
