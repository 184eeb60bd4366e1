"""Undo and redo of changes of the settings."""

from time import monotonic

from dechirp.experiments.scenario import Scenario

_MAX_CHANGES = 100
_SAME_CHANGE_S = 1.0
"""Changes of one setting within this time are one: a slider makes thirty a second."""


class UndoHistory:
    """Scenarios before and after the current one."""

    def __init__(self) -> None:
        self._earlier: list[Scenario] = []
        self._later: list[Scenario] = []
        self._last_change: tuple[frozenset[str], float] = frozenset(), 0.0

    @property
    def can_undo(self) -> bool:
        """True if there is an earlier scenario."""
        return bool(self._earlier)

    @property
    def can_redo(self) -> bool:
        """True if a change was undone and nothing was changed since."""
        return bool(self._later)

    def record_change(self, earlier: Scenario, keys: frozenset[str]) -> None:
        """Record the scenario before a change of the settings with these keys."""
        last_keys, last_s = self._last_change
        now_s = monotonic()
        is_same_change = keys == last_keys and now_s - last_s < _SAME_CHANGE_S
        self._last_change = keys, now_s
        if not (is_same_change and self._earlier):
            self._earlier = [*self._earlier, earlier][-_MAX_CHANGES:]
        self._later.clear()

    def step_back(self, current: Scenario) -> Scenario:
        """Return the scenario before the last change; the current one can be restored."""
        self._later.append(current)
        self._last_change = frozenset(), 0.0
        return self._earlier.pop()

    def step_forward(self, current: Scenario) -> Scenario:
        """Return the scenario after the last change that was undone."""
        self._earlier.append(current)
        self._last_change = frozenset(), 0.0
        return self._later.pop()
