"""The live page: every view and panel, in their places, in one document."""

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from time import perf_counter

from bokeh.document import Document

from dechirp.experiment.scenario import Scenario
from dechirp.studio.browser import Browser, script, text_of
from dechirp.studio.moment import Moment
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.compare import Compare
from dechirp.studio.panels.findings import Findings
from dechirp.studio.panels.hardware import Hardware
from dechirp.studio.panels.processing import Processing
from dechirp.studio.panels.radar import Radar
from dechirp.studio.panels.recordings import Recordings
from dechirp.studio.panels.requirements import Requirements
from dechirp.studio.panels.settings_file import SettingsFile
from dechirp.studio.panels.targets import Targets
from dechirp.studio.panels.transport import Transport
from dechirp.studio.panels.trouble import Trouble
from dechirp.studio.session import Session
from dechirp.studio.settings import Limits
from dechirp.studio.theme import DARK, LIGHT, of_pages, of_widgets
from dechirp.studio.views.base import View
from dechirp.studio.views.beat import Beat
from dechirp.studio.views.cut import Cut
from dechirp.studio.views.detections import Detections
from dechirp.studio.views.micro_doppler import MicroDoppler
from dechirp.studio.views.range_azimuth import RangeAzimuth
from dechirp.studio.views.range_doppler import RangeDoppler
from dechirp.studio.views.scene import Scene
from dechirp.studio.views.tracks import Tracks

_WORDS_S = 0.2
"""Shortest time between two changes of words while it plays."""
_VIEWS: tuple[type[View], ...] = (
    Scene,
    RangeDoppler,
    RangeAzimuth,
    Beat,
    Cut,
    MicroDoppler,
    Detections,
    Tracks,
)
_PANELS: tuple[type[Panel], ...] = (
    Transport,
    Trouble,
    Radar,
    Targets,
    Hardware,
    Processing,
    Requirements,
    SettingsFile,
    Compare,
    Recordings,
    Findings,
)


def page(document: Document, *, worker: Executor, scenario: Scenario, limits: Limits) -> None:
    """Fill the document of a browser that just came."""
    session = Session(document, worker, scenario, limits)
    browser = Browser(name="browser")
    place = partial(_tell_place, browser, session)
    views = [kind(session) for kind in _VIEWS]
    panels = [kind(session) for kind in _PANELS]
    parts: list[View | Panel] = [*views, *panels]
    for view in views:
        session.on_moment.append(_seldom(session, view.show, view.least_s))
        session.on_moment.append(_seldom(session, view.tell, _WORDS_S))
    session.on_moment.append(_seldom(session, lambda _: place(), _WORDS_S))
    session.on_wait.append(partial(place, waits=True))
    # Of what cannot be computed no moment comes.
    session.on_trouble.append(lambda mistakes: place() if mistakes else None)
    # After all others: what was sent before is drawn by then.
    session.on_moment.append(lambda _: browser.update(shown=browser.shown + 1))

    def wear(_attr: str, _old: bool, dark: bool) -> None:
        for part in parts:
            part.wear(DARK if dark else LIGHT)

    browser.on_change("drawn", lambda attr, old, new: session.drawn(new))
    browser.on_change("play_keys", lambda attr, old, new: session.play(not session.playing))
    browser.on_change("step_keys", lambda attr, old, new: session.go(session.step + 1))
    browser.on_change("free_keys", lambda attr, old, new: session.point(None))
    browser.on_change("dark", wear)
    wear("dark", False, False)

    roots = [part.root for part in parts]
    roots[0].tags = [browser]  # no root itself: there is nothing of it to see
    document.theme = of_widgets()
    with document.models.freeze():  # or it looks through all models for each root
        for root in roots:
            document.add_root(root)
    document.title = "dechirp studio"
    document.template = text_of("page.html")
    document.template_variables.update(style=of_pages(), script=script())
    document.on_session_destroyed(lambda _: session.close())
    session.start()


def _tell_place(browser: Browser, session: Session, *, waits: bool = False) -> None:
    """Say which frame is shown, and whether another one is waited for."""
    at = session.moment
    words = [] if at is None else [f"frame {at.number}, {at.time_s:.3f} s"]
    browser.place = "; ".join([*words, "computing ..."] if waits else words)


def _seldom(
    session: Session, show: Callable[[Moment], None], least_s: float
) -> Callable[[Moment], None]:
    """Show moments; while it plays, on average none sooner than that after the last one."""
    due_s = 0.0

    def shown(moment: Moment) -> None:
        nonlocal due_s
        now_s = perf_counter()
        if not session.playing or now_s >= due_s:
            # From when it was due: else each would wait for the first frame after its time.
            due_s = min(max(due_s, now_s - least_s), now_s) + least_s
            show(moment)

    return shown
