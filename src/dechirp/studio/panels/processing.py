"""Panel of the processing chain, the clusters and the tracker."""

from functools import partial

from bokeh.models import UIElement

from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.knob_widgets import KnobForm, make_setting_changer
from dechirp.studio.panels.knobs import NONE
from dechirp.studio.scenario_edits import apply_overrides
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_PROBABILITY, _OFFSET = "chain.cfar.false_alarm_probability", "chain.cfar.offset"
_ALTERNATIVES = {_PROBABILITY: _OFFSET, _OFFSET: _PROBABILITY}
"""A detector has exactly one of these two settings."""
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
    "group_tracker",
    "chain.mitigation",
)
_GROUPS = {
    "chain.cfar": "Detector",
    "chain.angle": "Directions",
    "chain.field_of_view": "Directions",
    "chain.cluster": "Objects and tracks",
    "ego_motion": "Objects and tracks",
    "tracker": "Objects and tracks",
    "group_tracker": "Objects and tracks",
    "chain.mitigation": "Mitigation of interference",
}


def _group_of_setting(path: str) -> str:
    titles = (title for start, title in _GROUPS.items() if f"{path}.".startswith(f"{start}."))
    return next(titles, "Range and velocity")


class Processing(Panel):
    """Knobs of the chain and of the tracker."""

    name = "processing"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._change_single = make_setting_changer(session)
        self._form = KnobForm(
            session.scenario,
            lambda _: _PATHS,
            self._change_setting_and_clear_alternative,
            group=_group_of_setting,
            open_groups=("Range and velocity", "Detector"),
        )
        self._form.root_element.name = self.name
        session.on_settings.append(self._form.show_settings_of)
        session.on_mistakes.append(self._form.show_mistakes)

    @property
    def root_element(self) -> UIElement:
        return self._form.root_element

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _change_setting_and_clear_alternative(self, path: str, text: str) -> None:
        alternative = _ALTERNATIVES.get(path)
        if alternative is None or not text:
            self._change_single(path, text)
            return
        options = (f"{path}={text}", f"{alternative}={NONE}")
        self.session.queue_edit(
            path,
            partial(apply_overrides, overrides=options, limits=self.session.limits),
            retry=True,
        )
