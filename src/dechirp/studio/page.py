"""Live page: all views and panels in one document."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from time import perf_counter

from bokeh.document import Document

from dechirp.core.errors import Mistake
from dechirp.experiments.scenario import Scenario
from dechirp.studio.browser_events import BrowserState, browser_javascript, read_studio_asset_text
from dechirp.studio.compilation import compilation_counter, compile_in_background
from dechirp.studio.frame_state import FrameState
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.compare import Compare
from dechirp.studio.panels.hardware import Hardware
from dechirp.studio.panels.main_settings import MainSettings
from dechirp.studio.panels.messages import Errors, Findings
from dechirp.studio.panels.processing import Processing
from dechirp.studio.panels.radar import Radar
from dechirp.studio.panels.recordings import Recordings
from dechirp.studio.panels.requirements import Requirements
from dechirp.studio.panels.settings_file import SettingsFile
from dechirp.studio.panels.targets import Targets
from dechirp.studio.panels.transport import Transport
from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.session import Session
from dechirp.studio.teach import lesson_page_builders_by_address
from dechirp.studio.theme import DARK, LIGHT, bokeh_widget_theme, page_css
from dechirp.studio.views.base import SLOW_INTERVAL_S, View
from dechirp.studio.views.beat import BeatView
from dechirp.studio.views.detections import DetectionsView
from dechirp.studio.views.micro_doppler import MicroDopplerView
from dechirp.studio.views.range_azimuth import RangeAzimuthView
from dechirp.studio.views.range_doppler import RangeDopplerView
from dechirp.studio.views.scene import SceneView
from dechirp.studio.views.threshold_cuts import ThresholdCutView
from dechirp.studio.views.tracks import TracksView

_VIEWS: tuple[type[View], ...] = (
    SceneView,
    RangeDopplerView,
    RangeAzimuthView,
    BeatView,
    ThresholdCutView,
    MicroDopplerView,
    DetectionsView,
    TracksView,
)
_PANELS: tuple[type[Panel], ...] = (
    Transport,
    Errors,
    MainSettings,
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


def build_live_page(
    document: Document, *, worker: Executor, scenario: Scenario, limits: PageLimits
) -> None:
    """Fill the document of a new browser session."""
    session = Session(document, worker, scenario, limits)
    browser = BrowserState(name="browser")
    update_status = partial(_update_frame_status, browser, session)
    views = [kind(session) for kind in _VIEWS]
    panels = [kind(session) for kind in _PANELS]
    parts: list[View | Panel] = [*views, *panels]
    session.on_frame += [
        _call_every_nth_step(session, view.show_frame, view.frames_per_update)
        for view in views
        if view.frames_per_update is not None
    ]
    # All at the same frames: else texts and tables of one screen would count different frames.
    slow: list[Callable[[FrameState], object]] = [
        *(view.show_frame for view in views if view.frames_per_update is None),
        *(view.update_caption for view in views),
        *(panel.show_frame_number for panel in panels),
        lambda _: update_status(),
    ]
    session.on_frame.append(_limit_call_rate(session, lambda frame: [show(frame) for show in slow]))
    session.on_wait.append(partial(update_status, is_waiting=True))
    # A frame that fails sends no frame state.
    session.on_mistakes.append(lambda mistakes: update_status() if mistakes else None)
    session.on_mistakes.append(partial(_show_last_frame_again, session, views))
    # After all other callbacks: everything sent before is then drawn.
    session.on_frame.append(lambda _: browser.update(n_frames_sent=browser.n_frames_sent + 1))

    def apply_shade(_attr: str, _old: bool, dark: bool) -> None:
        for part in parts:
            part.apply_theme(DARK if dark else LIGHT)

    browser.on_change("n_frames_drawn", lambda attr, old, new: session.confirm_frames_drawn(new))
    browser.on_change("play_keys", lambda attr, old, new: session.set_playing(not session.playing))
    browser.on_change("step_keys", lambda attr, old, new: session.go_to_step(session.step + 1))
    browser.on_change("free_keys", lambda attr, old, new: session.move_cursor(None))
    browser.on_change("undo_keys", lambda attr, old, new: session.undo())
    browser.on_change("redo_keys", lambda attr, old, new: session.redo())
    browser.on_change("shared_settings", lambda attr, old, new: session.replace_settings(new))
    browser.on_change("dark", apply_shade)
    apply_shade("dark", False, False)

    roots = [part.root_element for part in parts]
    # Not roots: they have no visual part.
    roots[0].tags = [browser, *(view.caption for view in views)]
    for view in views:
        if view.controls is not None:
            view.controls.update(name=f"{view.name}-controls", css_classes=["small"])
            roots.append(view.controls)
    document.theme = bokeh_widget_theme()
    # Bokeh connects to an ended session, and fails with arrays: connection.js reports the loss.
    document.config.update(reconnect_session=False, notify_connection_status=False)
    with document.models.freeze():  # else Bokeh scans all models for each root
        for root in roots:
            document.add_root(root)
    document.title = "dechirp studio"
    document.template = read_studio_asset_text("page.html")
    document.template_variables.update(style=page_css(), script=browser_javascript())
    document.on_session_destroyed(lambda _: session.close())
    session.start()


def _update_frame_status(
    browser: BrowserState, session: Session, *, is_waiting: bool = False
) -> None:
    """Show the number of the frame, and whether another one is being computed."""
    frame = session.frame_state
    parts = [] if frame is None else [f"frame {frame.number}, {frame.time_s:.3f} s"]
    if not (session.shows_current_settings or is_waiting or frame is None):
        parts.append("outdated")
    if is_waiting:
        progress = compilation_counter().progress_text if frame is None else ""
        parts.append(progress or f"{session.activity} ...")
    browser.update(
        frame_status="; ".join(parts),
        is_outdated=not session.shows_current_settings and frame is not None,
    )


def _call_every_nth_step(
    session: Session, show: Callable[[FrameState], object], n: int
) -> Callable[[FrameState], None]:
    """Wrap a callback so that it runs at every n-th step during playback, and else at each.

    Where frames take long, it also runs 5 times a second.
    """
    shown_s = 0.0

    def show_if_due(frame_state: FrameState) -> None:
        nonlocal shown_s
        now_s = perf_counter()
        is_due = frame_state.step % n == 0 or now_s - shown_s >= SLOW_INTERVAL_S
        if not session.playing or is_due:
            shown_s = now_s
            show(frame_state)

    return show_if_due


def _show_last_frame_again(
    session: Session, views: Sequence[View], mistakes: tuple[Mistake, ...]
) -> None:
    """Show the last frame in maps that playback skips, as a mistake ends it without a new one."""
    if mistakes and session.frame_state is not None:
        for view in views:
            if view.frames_per_update is not None and view.frames_per_update > 1:
                view.show_frame(session.frame_state)


def _limit_call_rate(
    session: Session, show: Callable[[FrameState], object]
) -> Callable[[FrameState], None]:
    """Wrap a callback so that it runs 5 times a second at most, on average, during playback."""
    due_s = 0.0

    def show_if_due(frame_state: FrameState) -> None:
        nonlocal due_s
        now_s = perf_counter()
        if not session.playing or now_s >= due_s:
            # Count from the due time; else each call would wait for the next frame after it.
            due_s = min(max(due_s, now_s - SLOW_INTERVAL_S), now_s) + SLOW_INTERVAL_S
            show(frame_state)

    return show_if_due


def page_builders_by_address(
    worker: Executor, *, scenario: Scenario, limits: PageLimits
) -> dict[str, Callable[[Document], None]]:
    """Return the builders of the live page and the lessons by address; start to compile."""
    compilation_counter()
    compile_in_background(worker, scenario, limits)
    live_page = partial(build_live_page, worker=worker, scenario=scenario, limits=limits)
    return {"/": live_page, **lesson_page_builders_by_address(worker, limits)}
