"""How samples become detections, clusters and tracks, in the order in which it happens."""

from functools import partial

from bokeh.models import UIElement

from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.entries import NONE
from dechirp.studio.panels.fields import Form, changer
from dechirp.studio.session import Session
from dechirp.studio.settings import changed
from dechirp.studio.theme import Theme

_PROBABILITY, _OFFSET = "chain.cfar.false_alarm_probability", "chain.cfar.offset"
_INSTEAD = {_PROBABILITY: _OFFSET, _OFFSET: _PROBABILITY}
"""Of the two a detector has one."""
_PATHS = (
    "chain.range_window",
    "chain.n_range_bins",
    "chain.doppler_window",
    "chain.n_velocity_bins",
    "chain.range_walk",
    "chain.cfar.estimator",
    "chain.cfar.n_training",
    "chain.cfar.n_guard",
    _PROBABILITY,
    _OFFSET,
    "chain.angle",
    "chain.field_of_view",
    "chain.cluster",
    "ego_motion",
    "tracker",
    "chain.mitigation",
)


class Processing(Panel):
    """Knobs of the chain and of the tracker."""

    name = "processing"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._one_by_one = changer(session)
        self._form = Form(session.scenario, lambda _: _PATHS, self._change)
        self._form.root.name = self.name
        session.on_settings.append(self._form.show)
        session.on_trouble.append(self._form.tell)

    @property
    def root(self) -> UIElement:
        """The knobs."""
        return self._form.root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _change(self, path: str, text: str) -> None:
        other = _INSTEAD.get(path)
        if other is None or not text:
            self._one_by_one(path, text)
            return
        both = (f"{path}={text}", f"{other}={NONE}")
        self.session.edit(path, partial(changed, options=both, limits=self.session.limits))
