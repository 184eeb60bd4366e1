"""The scene from above: x forward is up, y left is left; targets can be dragged."""

from functools import partial

import numpy as np
from bokeh.events import DoubleTap, Pan, PanEnd, PanStart, Tap
from bokeh.models import UIElement

from dechirp.core.displayed import several
from dechirp.core.errors import InvalidSetting, Mistake
from dechirp.core.words import TIMES, number
from dechirp.experiment.scenario import Scenario
from dechirp.report.figures.ground import magnified, round_down
from dechirp.scene.folding import Place, on_map
from dechirp.scene.scene import Scene as Targets
from dechirp.studio.browser import on_place
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cursor
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.dragged import start_m, written
from dechirp.studio.views.drawn import joined
from dechirp.studio.views.ground import Ground, arc_m, put
from dechirp.studio.views.places import ranges_alone, with_directions
from dechirp.studio.views.standing import standing
from dechirp.studio.views.tails import Tails

_MOST_ELLIPSES, _MOST_ARCS = 60, 20
_FEW = 15  # detections that are drawn large
_NEAR = 0.08  # of the reach: so near a pointer holds a target
_LARGER = 0.3  # of the widest ellipse, which is drawn so much wider than is usual: a tenth aside
_ARROW = 0.25  # of the reach: the way of the fastest


class Scene(View):
    """Targets, detections and tracks about the radar; a tap puts the cursor."""

    name = "scene"
    least_s = 0.19

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.ground = Ground(self.name)
        self._there = standing(Targets(), 0.0)
        self._tails = Tails()
        self._shown: tuple[float, float] | None = None
        """Span of ranges and field of view that the picture was fitted to."""
        self._times = 0.0
        """How much larger than they are errors are drawn; 0: not chosen yet."""
        self._held: tuple[str, tuple[float, float]] | None = None
        """The target that is dragged, and its x and y."""
        self._is_let_go = False
        self._said = ""
        """What the marks mean that were drawn last."""
        for event, heard in (
            (PanStart, self._hold),
            (Pan, self._drag),
            (PanEnd, self._drag),
            (Tap, self._point),
        ):
            on_place(self.ground.figure, event, heard)
        self.ground.figure.on_event(PanEnd, lambda _: self._let_go())
        self.ground.figure.on_event(DoubleTap, lambda _: session.point(None))
        session.on_settings.append(self._settle)
        session.on_trouble.append(self._give_up)

    @property
    def root(self) -> UIElement:
        """What the page embeds."""
        return self.ground.figure

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self.ground.wear(theme)

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        scene = None if moment.truth is None else self.session.scenario.scene
        self._there = standing(scene or Targets(), moment.time_s)
        self._fit(moment)
        marks = [self._show_targets(), self._show_found(moment), self._show_tracks(moment)]
        self._said = "   ".join(mark for mark in marks if mark)
        half_rad = moment.chain.field_of_view.azimuth_rad
        put(self.ground.cursor, arc_m(moment.cursor.range_m, half_rad))

    def tell(self, moment: Moment) -> None:
        """Put into words what is seen."""
        words = [] if moment.truth is None else [several(len(self._there.names), "target")]
        words.append(f"{moment.detections.sizes['detection']} detected")
        if moment.tracks:
            words.append(several(len(moment.tracks), "track"))
        self.ground.figure.title.text = f"From above: {', '.join(words)}"
        self.ground.note.text = self._said

    def _fit(self, moment: Moment) -> None:
        """Take all that there is into the picture, and leave it so until more is needed."""
        seen_m = moment.detections.range.values
        if moment.truth is not None:
            seen_m = np.hypot(*self._there.places_m.T)
        farthest_m = float(seen_m.max(initial=0.0))
        span_m = float(moment.power.range[-1])
        shown = span_m, moment.chain.field_of_view.azimuth_rad
        fits = shown == self._shown and farthest_m <= self.ground.reach_m
        if fits or self._held is not None:
            return
        self._shown, self._times = shown, 0.0
        reach_m = max(min(2 * farthest_m or span_m, span_m), 1.15 * farthest_m)
        self.ground.fit(reach_m, moment.chain.field_of_view.azimuth_rad)

    def _show_targets(self) -> str:
        there, reach_m = self._there, self.ground.reach_m
        places_m = there.places_m.copy()
        if self._held is not None and self._held[0] in there.names:
            places_m[there.names.index(self._held[0])] = self._held[1]
        fastest = float(np.hypot(*there.velocities_m_per_s.T).max(initial=0.0))
        while_s = round_down(_ARROW * reach_m / fastest) if fastest > 0 else 0.0
        ends_m = places_m + while_s * there.velocities_m_per_s
        self.ground.stand(there.names, places_m[:, ::-1], ends_m[:, ::-1])
        put(self.ground.points, there.points_m[:, ::-1])
        if not there.names:
            return ""
        return f"● true, → way in {number(while_s)} s" if while_s else "● true"

    def _show_found(self, moment: Moment) -> str:
        seen, rest_m = with_directions(moment), ranges_alone(moment)
        put(self.ground.found, seen.places_m[:, ::-1])
        self.ground.found.glyph.size = 13 if len(seen.range_m) <= _FEW else 7
        if not self._times and len(seen.range_m):
            across_m = float(np.nanmax(seen.range_m * seen.azimuth_std_rad))
            self._times = magnified(across_m * _LARGER, 2 * self.ground.reach_m)
        ellipses_m = seen.places_m[:, :, None] + self._times * seen.ellipses_m()
        lines = [line[::-1].T for line in ellipses_m[:_MOST_ELLIPSES]]
        half_rad = moment.chain.field_of_view.azimuth_rad
        arcs = [arc_m(range_m, half_rad) for range_m in rest_m[:_MOST_ARCS]]
        put(self.ground.errors, joined([*lines, *arcs]))
        if lines:
            return f"○ detected, errors {TIMES}{number(self._times)}"
        return "arcs: detected, no direction" if arcs else ""

    def _show_tracks(self, moment: Moment) -> str:
        self._tails.grow(moment)
        ends = [(track.state[2], track.state[0]) for track in moment.tracks]
        put(self.ground.tracks, np.array(ends).reshape(-1, 2))
        put(self.ground.tails, joined(self._tails.lines_m))
        return "◇ track" if ends else ""

    # Pointing and dragging.

    def _near(self, x: float, y: float) -> int | None:
        """The target at a place of the picture, if there is one."""
        away_m = np.hypot(*(self._there.places_m - (y, x)).T)
        if not away_m.size or away_m.min() > _NEAR * self.ground.reach_m:
            return None
        return int(away_m.argmin())

    def _point(self, x: float, y: float) -> None:
        moment, near = self.session.moment, self._near(x, y)
        if moment is None:
            return
        cursor = Cursor(float(np.hypot(x, y)), moment.cursor.velocity_m_per_s)
        if near is not None and moment.truth is not None:
            there = (moment.truth[of].values.ravel()[near] for of in ("range", "velocity"))
            cursor = Cursor(*map(float, on_map(Place(*there), moment.radar)))
        self.session.point(cursor)

    def _hold(self, x: float, y: float) -> None:
        near = self._near(x, y)
        if near is not None:
            self._held, self._is_let_go = (self._there.names[near], (y, x)), False

    def _drag(self, x: float, y: float) -> None:
        moment, scene = self.session.moment, self.session.scenario.scene
        if self._held is None or self._is_let_go or moment is None or scene is None:
            return
        name, _ = self._held
        if name not in scene.names:  # taken out meanwhile
            self._held = None
            return
        path = f"scene.targets.{label(scene, name)}.position"
        try:
            at_m = start_m(scene, name, (y, x), moment.time_s)
        except InvalidSetting as error:
            self._held = None
            self.session.edit(path, partial(_refuse, error))
            return
        self._held = name, (y, x)
        self._show_targets()
        self.session.change(path, written(at_m))

    def _let_go(self) -> None:
        self._is_let_go = True

    def _settle(self, _: Scenario) -> None:
        """Settings have changed: errors have another size, and what was let go has arrived."""
        self._times = 0.0
        if self._is_let_go:
            self._held = None

    def _give_up(self, mistakes: tuple[Mistake, ...]) -> None:
        if mistakes and self._held is not None:
            self._held = None
            self._show_targets()


def label(scene: Targets, name: str) -> str:
    """What a path of settings calls a target by: its name, or its place in the list."""
    place = scene.names.index(name)
    own = scene.targets[place].name
    return str(place) if own is None or "." in own else own


def _refuse(error: InvalidSetting, _: Scenario) -> Scenario:
    raise error
