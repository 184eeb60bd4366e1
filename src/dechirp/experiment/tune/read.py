"""A search as a settings file holds it.

::

    scenarios: [reference.yaml]     # files, or scenarios themselves; or, or beside them,
    recordings:
      - scenario: recorded.yaml     # a scenario with `recording:`
        truth: {targets: [{name: reflector, position: [5 m, 0 m, 0 m], velocity: [0, 0, 0]}]}
        empty: [20 m, 60 m]         # ranges where nothing was: alarms there are false
    seed: 7
    search:                         # paths as --set takes them; values as in a study's vary
      chain.cfar.estimator: [{kind: cell-averaging}, {kind: greatest-of}]
      chain.cfar.n_training.range: {from: 4, to: 24, step: 1}
      chain.cfar.false_alarm_probability: {from: 1e-8, to: 1e-5, n: 13, spacing: log}
    aim:
      most: detection_probability   # or least: range_rmse
      at_most: {false_alarm_probability: 1e-6}      # at_least as well; any scores
    looks: 200                      # trials of each candidate, the same for all
    candidates: 60
    fresh_looks: 1000               # trials in which the best must show its gain
    confidence: 0.95
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from dechirp.config.fields import Slot
from dechirp.config.files import in_order, of_tree, text_in, value_of
from dechirp.config.mistakes import Spot
from dechirp.config.models import Context
from dechirp.config.nearest import OR_NONE, did_you_mean
from dechirp.config.quantities import quantity
from dechirp.config.texts import line
from dechirp.config.tree import Node, dotted, read_tree, repeated
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting, Mistake
from dechirp.core.values import value
from dechirp.evaluate.score.base import Score
from dechirp.experiment.scenario import READERS, Scenario, load
from dechirp.experiment.study.study import Drawn, Listed
from dechirp.experiment.study.text import unit_of
from dechirp.experiment.study.variants import Variants, must_be_apart
from dechirp.experiment.study.vary import values_of
from dechirp.experiment.tune.tune import Aim, Limit, Recorded, Tune
from dechirp.scene.scene import Scene

T = TypeVar("T")

_MOST_VALUES = 10_000
_AT_ONCE = 10  # values of one setting that cannot be
SEARCHED = ("chain", "ego_motion", "tracker")
_NAMES = ("scenarios", "recordings", "search", "aim")


@value
class PlainSettings:
    """What is one number or word of the file."""

    name: str = "tune"
    seed: int = 0
    looks: int = 200
    candidates: int = 60
    fresh_looks: int = 1000
    confidence: float = 0.95


def load_tune(path: str | Path, overrides: Sequence[str] = (), *, seed: int | None = None) -> Tune:
    """Search of a settings file, its scenarios with settings replaced by `PATH=VALUE` texts.

    Raises
    ------
    InvalidFile
        With every mistake of the file, each with its line and column.
    """
    path = Path(path)
    return _Reader(path, tuple(overrides), seed).tune()


class _Reader:
    """One file, and the mistakes found so far."""

    def __init__(self, path: Path, overrides: Sequence[str], seed: int | None) -> None:
        self.path, self.overrides, self.seed = path, overrides, seed
        self.context = Context(base=path.absolute().parent, readers=READERS)
        self.wrong: list[Mistake] = []

    def tune(self) -> Tune:
        tree = read_tree(text_in(self.path), str(self.path))
        self.wrong += repeated(tree)
        if not isinstance(tree.content, dict):
            raise InvalidFile(
                tree.place.mistake(
                    "the file",
                    got="empty" if tree.content is None else tree.shown,
                    need="the settings of a search",
                    fix="Write scenarios, search and aim.",
                )
            )
        given = dict(tree.content)
        parts = {name: given.pop(name, None) for name in _NAMES}
        plain = self._of_file(given, tree)
        scenarios = self._members(parts["scenarios"], "scenarios", self._scenario)
        recordings = self._members(parts["recordings"], "recordings", self._recorded)
        every = [*scenarios, *(one.scenario for one in recordings)]
        search = self._search(parts["search"], tree, every) if every else ()
        aim = self._aim(parts["aim"], tree)
        if self.wrong or aim is None or plain is None:
            raise InvalidFile(*in_order(self.wrong))
        told = {name: getattr(plain, name) for name in plain.__dataclass_fields__}
        if self.seed is not None:
            told["seed"] = self.seed
        try:
            return Tune(
                scenarios=tuple(scenarios),
                recordings=tuple(recordings),
                search=search,
                aim=aim,
                **told,
            )
        except InvalidSetting as error:
            raise InvalidFile(*self._placed(error, tree)) from None

    def _of_file(self, given: dict[str, Node], tree: Node) -> PlainSettings | None:
        known = (*PlainSettings.__dataclass_fields__, *_NAMES)
        for name in [name for name in given if name not in PlainSettings.__dataclass_fields__]:
            self.wrong.append(
                given.pop(name).named_at.mistake(
                    dotted("", name),
                    got="not a known name",
                    need=f"one of {', '.join(known)}",
                    fix=did_you_mean(name, known, OR_NONE),
                )
            )
        spot = Spot("", replace(tree, content=given, repeated=()), Slot(PlainSettings))
        return self._heard(lambda: value_of(spot, self.context))

    def _members(
        self, node: Node | None, name: str, read: Callable[[str, Node], T | None]
    ) -> list[T]:
        if node is None:
            return []
        if not isinstance(node.content, list):
            self._refuse(node, name, need="a list", fix="Write it in brackets, even one alone.")
            return []
        found = (read(f"{name}.{at}", one) for at, one in enumerate(node.content))
        return [one for one in found if one is not None]

    def _scenario(self, path: str, node: Node) -> Scenario | None:
        if isinstance(node.content, str):
            file = self.context.base / node.content
            return self._heard(lambda: load(file, self.overrides))
        if not isinstance(node.content, dict):
            self._refuse(
                node, path, need="a scenario, or the name of its file", fix="Name the file."
            )
            return None
        return self._heard(lambda: of_tree(node, Scenario, self.context, overrides=self.overrides))

    def _recorded(self, path: str, node: Node) -> Recorded | None:
        if not isinstance(node.content, dict) or "scenario" not in node.content:
            self._refuse(
                node,
                path,
                need="a mapping of scenario, and truth or empty or both",
                fix="Write scenario: FILE, a scenario that has a recording.",
            )
            return None
        given = dict(node.content)
        scenario = self._scenario(f"{path}.scenario", given.pop("scenario"))
        truth, empty = given.pop("truth", None), given.pop("empty", None)
        for name, child in given.items():
            self.wrong.append(
                child.named_at.mistake(
                    dotted(path, name),
                    got="not a known name",
                    need="one of scenario, truth, empty",
                    fix=did_you_mean(name, ("scenario", "truth", "empty"), OR_NONE),
                )
            )
        scene = Scene()
        if truth is not None:
            spot = Spot(f"{path}.truth", truth, Slot(Scene))
            scene = self._heard(lambda: value_of(spot, self.context)) or scene
        empty_m = None
        if empty is not None:
            slot = Slot(tuple[float, float], "m", "empty")
            empty_m = self._heard(
                lambda: value_of(Spot(f"{path}.empty", empty, slot), self.context)
            )
        if scenario is None:
            return None
        try:
            return Recorded(scenario=scenario, truth=scene, empty_m=empty_m)
        except InvalidSetting as error:
            self.wrong += self._placed(error, node)
            return None

    def _search(
        self, node: Node | None, tree: Node, scenarios: Sequence[Scenario]
    ) -> tuple[Listed, ...]:
        if node is None or not isinstance(node.content, dict) or not node.content:
            self.wrong.append(
                (node or tree).named_at.mistake(
                    "search",
                    got="absent" if node is None else node.shown,
                    need="settings to search, with their values",
                    fix="Write chain.cfar.n_guard.range: {from: 1, to: 6, step: 1}, for instance.",
                )
            )
            return ()
        found: list[Listed] = []
        every = [Variants(one) for one in scenarios]
        for path, values in node.content.items():
            listed = self._heard(partial(self._listed, path, values, every))
            if listed is not None:
                found.append(listed)
        try:
            must_be_apart([every[0].way(one.path) for one in found])
        except InvalidSetting as error:
            self.wrong += [_at(one, node.named_at, "search") for one in error.mistakes]
        return tuple(found)

    def _listed(self, path: str, node: Node, every: Sequence[Variants]) -> Listed:
        """Values of one setting, each tried on each scenario by itself."""
        name = f"search.{path}"
        try:
            leaf = every[0].way(path).leaf
        except InvalidSetting as error:
            raise InvalidFile(*(_at(one, node.named_at, name) for one in error.mistakes)) from None
        if path.partition(".")[0] not in SEARCHED:
            raise InvalidFile(
                node.named_at.mistake(
                    name,
                    got="no setting of what is made of samples",
                    need=f"a setting in one of {', '.join(SEARCHED)}",
                    fix="Vary it in a study: it changes what there is to find.",
                )
            )
        try:
            axis, tried = values_of(path, node, leaf, self.context, at_most=_MOST_VALUES)
        except InvalidFile as error:
            own = (
                replace(one, setting=one.setting.replace(f"vary.{path}", name, 1))
                for one in error.mistakes
            )
            raise InvalidFile(*own) from None
        if isinstance(axis, Drawn):
            raise InvalidFile(
                node.place.mistake(
                    name,
                    got="a distribution",
                    need="a list or a range: a search takes values, it does not draw them",
                    fix="Write {from: ..., to: ..., step: ...}.",
                )
            )
        wrong = [
            _at(mistake, one.place, name, line(one))
            for one in tried
            for variants in every
            for mistake in _refused(variants, path, line(one))
        ]
        if wrong:
            raise InvalidFile(*list(dict.fromkeys(wrong))[:_AT_ONCE])
        return axis

    def _aim(self, node: Node | None, tree: Node) -> Aim | None:
        if node is None or not isinstance(node.content, dict):
            self.wrong.append(
                (node or tree).named_at.mistake(
                    "aim",
                    got="absent" if node is None else node.shown,
                    need="a score that is to be most or least, with limits of others",
                    fix="Write {most: detection_probability,"
                    " at_most: {false_alarm_probability: 1e-6}}.",
                )
            )
            return None
        given = node.content
        known = ("most", "least", "at_most", "at_least")
        for name in given:
            if name not in known:
                self.wrong.append(
                    given[name].named_at.mistake(
                        dotted("aim", name),
                        got="not a known name",
                        need=f"one of {', '.join(known)}",
                        fix=did_you_mean(name, known, OR_NONE),
                    )
                )
        ways = [name for name in ("most", "least") if name in given]
        if len(ways) != 1:
            self.wrong.append(
                node.named_at.mistake(
                    "aim",
                    got="without most or least" if not ways else "most and least at once",
                    need="one of them, with the name of a score",
                    fix="Write most: detection_probability.",
                )
            )
            return None
        own = given[ways[0]]
        score = self._score(f"aim.{ways[0]}", own, own.text)
        limits = [
            limit
            for side in ("at_most", "at_least")
            if side in given
            for limit in self._limits(side, given[side])
        ]
        if score is None:
            return None
        towards: Literal["most", "least"] = "most" if ways[0] == "most" else "least"
        try:
            return Aim(towards=towards, score=score, limits=tuple(limits))
        except InvalidSetting as error:
            self.wrong += [
                own.place.mistake(one.setting, got=one.got, need=one.need, fix=one.fix)
                for one in error.mistakes
            ]
            return None

    def _limits(self, side: str, node: Node) -> Iterator[Limit]:
        if not isinstance(node.content, dict):
            self._refuse(
                node,
                f"aim.{side}",
                need="a mapping of scores and their limits",
                fix="Write {false_alarm_probability: 1e-6}.",
            )
            return
        for label, child in node.content.items():
            path = f"aim.{side}.{label}"
            score = self._score(path, child, label)
            if score is None:
                continue
            try:
                bound = quantity(child.text, unit_of(score), setting=path)
                limit = Limit(score=score, **{side: bound})
            except InvalidSetting as error:
                self.wrong += [_at(one, child.place, path) for one in error.mistakes]
                continue
            yield limit

    def _score(self, path: str, node: Node, label: str) -> Score | None:
        members: Mapping[str, type] = Score.members()
        known = {kind.replace("-", "_"): member for kind, member in members.items()}
        if label not in known:
            self.wrong.append(
                node.named_at.mistake(
                    path,
                    got=label or node.shown,
                    need=f"a score: one of {', '.join(known)}",
                    fix=did_you_mean(label, known),
                )
            )
            return None
        score: Score = known[label]()
        if not score.repeatable:
            self._refuse(
                node,
                path,
                need="a score that is the same when the same trial is done again",
                fix="Measure it in a study of what is found.",
            )
            return None
        return score

    def _refuse(self, node: Node, path: str, *, need: str, fix: str) -> None:
        self.wrong.append(node.place.mistake(path, got=node.shown, need=need, fix=fix))

    def _heard(self, make: Callable[[], T]) -> T | None:
        """What is made; None, and its mistakes kept, where it cannot be."""
        try:
            return make()
        except InvalidFile as error:
            self.wrong += error.mistakes
        return None

    def _placed(self, error: DechirpError, node: Node) -> Iterator[Mistake]:
        """Mistakes of a value, where it is written."""
        for one in error.mistakes:
            _, _, rest = one.setting.partition(".")
            name = rest.removesuffix("_m")
            child = node.content.get(name) if isinstance(node.content, dict) else None
            place = (child or node).named_at
            yield place.mistake(name, got=one.got, need=one.need, fix=one.fix)


def _at(mistake: Mistake, place: Any, name: str, text: str = "") -> Mistake:
    """The same mistake, in the file of the search."""
    got = mistake.got
    if text:
        got = text if name.endswith(mistake.setting) else f"{text}, with {mistake.setting} {got}"
    made: Mistake = place.mistake(name, got=got, need=mistake.need, fix=mistake.fix)
    return made


def _refused(variants: Variants, path: str, text: str) -> tuple[Mistake, ...]:
    try:
        variants.of({path: text})
    except DechirpError as error:
        return error.mistakes
    return ()
