"""A study file to a `Study`, with all its mistakes at once.

`scenario` is the path of a scenario file, relative to the study file, or the scenario itself;
`vary.py` says what may be varied and how. `--set PATH=VALUE` goes to the scenario unless the path
begins with a setting of the study. Where the path is varied, the study keeps that one value: a
label of the axis, or any value.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dechirp.config import files
from dechirp.config.fields import Slot, settings
from dechirp.config.files import in_order, of_tree, text_in, value_of
from dechirp.config.mistakes import Spot, refused
from dechirp.config.models import Context
from dechirp.config.nearest import OR_NONE, did_you_mean
from dechirp.config.overrides import given, override
from dechirp.config.shown import shown
from dechirp.config.texts import line
from dechirp.config.tree import Node, Place, dotted, read_tree, repeated
from dechirp.config.within import Way
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting, Mistake
from dechirp.evaluate.score.base import Score
from dechirp.experiment.scenario import READERS, Scenario
from dechirp.experiment.study.study import (
    Drawn,
    Listed,
    Requirement,
    Study,
    Trials,
    wrong_at,
)
from dechirp.experiment.study.text import unit_of
from dechirp.experiment.study.variants import HERE, Variants, must_be_apart
from dechirp.experiment.study.vary import values_of

_PLAIN = (
    "name",
    "seed",
    "draw",
    "confidence",
    "stop_after_failures",
    "sensor",
    "at_most_points",
    "at_most_trials",
    "keep",
    "at_most_bytes",
)
_AT_ONCE = 10  # values of one setting that cannot be, before the rest is left untried


def load_study(path: str | Path, overrides: Iterable[str] = (), seed: int | None = None) -> Study:
    """Study of a YAML file.

    Parameters
    ----------
    path : str or Path
        The file; paths in it are relative to its folder, those in a scenario file to that one's.
    overrides : iterable of str
        PATH=VALUE, as after `--set`: of the scenario, but for paths that begin with a setting of
        the study other than `name` and `seed`; `vary.PATH=VALUE` varies one more, or otherwise.
        A path that is varied takes this one value or label, and requirements at other values
        are left out.
    seed : int, optional
        In place of the study's.

    Raises
    ------
    InvalidFile
        With every mistake of the file, of the scenario and of the options at once. Each value of
        a list is tried on the scenario alone, some of a long range, and the ends of what is drawn.
    """
    path = Path(path)
    file = _File(str(path), Context(base=path.absolute().parent, readers=READERS))
    file.open(text_in(path), overrides)
    file.read_plain()
    file.read_scenario()
    file.read_vary()
    file.read_scores()
    return file.study(seed)


@dataclass
class _File:
    """What is read of a file, part by part, and what is wrong with it."""

    name: str
    context: Context
    tree: Node = field(init=False)
    wrong: list[Mistake] = field(default_factory=list)
    read: dict[str, Any] = field(default_factory=dict)
    of_scenario: list[str] = field(default_factory=list)
    of_axes: dict[str, Node] = field(default_factory=dict)
    ways: dict[str, Way] = field(default_factory=dict)

    @property
    def content(self) -> Mapping[str, Node]:
        assert isinstance(self.tree.content, dict)
        return self.tree.content

    def open(self, text: str, overrides: Iterable[str]) -> None:
        """Take the text, and sort the options."""
        self.tree = read_tree(text, self.name)
        names = settings(Study)
        if not isinstance(self.tree.content, dict):
            raise InvalidFile(
                self.tree.place.mistake(
                    "the file",
                    got=self.tree.shown if self.tree.content is not None else "empty",
                    need=f"a mapping of {', '.join(names)}",
                    fix="Write scenario, vary and scores, each on a line of its own.",
                )
            )
        self.wrong += repeated(self.tree)
        for option in overrides:
            with self.collected():
                self._take(option)
        for name, node in self.content.items():
            if name not in names:
                self.wrong.append(
                    node.named_at.mistake(
                        dotted("", name),
                        got="not a known name",
                        need=f"one of {', '.join(names)}",
                        fix=did_you_mean(name, names, OR_NONE),
                    )
                )
        for name, what in (
            ("scenario", "the path of a scenario file, or the scenario itself"),
            ("scores", "a list of scores"),
        ):
            if name not in self.content:
                self.wrong.append(
                    self.tree.place.mistake(
                        name, got="missing", need=f"given: {what}", fix=f"Add {name}."
                    )
                )

    def _take(self, option: str) -> None:
        path, node = given(option)
        first, _, rest = path.partition(".")
        vary = self.content.get("vary")
        varied = vary.content if vary is not None and isinstance(vary.content, dict) else {}
        if path in varied:
            self.of_axes[path] = node
        elif first == "vary" and rest:
            place = vary.place if vary is not None else node.place
            whole = Node({**varied, rest: node}, place, place)
            self.tree = replace(self.tree, content={**self.content, "vary": whole})
        elif first == "scenario" and rest:
            self.of_scenario.append(option.partition(".")[2])
        elif first in settings(Study) and first not in ("name", "seed"):
            spot = Spot("", self.tree, Slot(Study))
            self.tree = override(spot, option, self.context)
        else:
            self.of_scenario.append(option)

    def read_plain(self) -> None:
        """Read the settings that need no other."""
        for name in _PLAIN:
            if name in self.content:
                spot = Spot(name, self.content[name], settings(Study)[name].slot)
                with self.collected():
                    self.read[name] = value_of(spot, self.context)

    def read_scenario(self) -> None:
        """Read the scenario, with the options that are its own."""
        node = self.content.get("scenario")
        if node is None:
            return
        need = "the path of a scenario file, or the scenario itself"
        with self.collected():
            if isinstance(node.content, str):
                path = self.context.base / node.content
                if not path.is_file():
                    raise _told(
                        node.place,
                        "scenario",
                        f"{node.shown}, which is no file",
                        need,
                        f"Paths start from {self.context.base}.",
                    )
                made = files.read(path, Scenario, overrides=self.of_scenario, readers=READERS)
            elif isinstance(node.content, dict):
                made = of_tree(node, Scenario, self.context, overrides=self.of_scenario)
            else:
                raise _told(
                    node.place, "scenario", node.shown, need, "Write scenario: scenario.yaml."
                )
            if made.scene is None:
                raise _told(
                    node.named_at,
                    "scenario",
                    "of a recording",
                    "of a scene that can be simulated again and again",
                    "Give a scene; dechirp tune takes recordings.",
                )
            self.read["scenario"] = made

    def read_vary(self) -> None:
        """Read what is varied, and try it on the scenario."""
        node = self.content.get("vary")
        if node is None or node.content is None:
            self.read["vary"] = ()
            return
        if "scenario" not in self.read:
            return
        if not isinstance(node.content, dict):
            self.wrong.append(
                node.place.mistake(
                    "vary",
                    got=node.shown,
                    need="a mapping of paths, as scene.targets.car.rcs, and their values",
                    fix="Write PATH: [VALUE, VALUE].",
                )
            )
            return
        variants = Variants(self.read["scenario"])
        at_most = self.read.get("at_most_points", Study.at_most_points)
        axes: list[Listed | Drawn] = []
        for path, child in node.content.items():
            with self.collected():
                axes.append(self._axis(path, child, variants, at_most))
        for option in self.of_scenario:
            self._beside(option, variants)
        if len(axes) == len(node.content):
            self.read["vary"] = tuple(axes)

    def _axis(self, path: str, node: Node, variants: Variants, at_most: int) -> Listed | Drawn:
        if path == "seed":
            raise _told(
                node.named_at,
                "vary.seed",
                "varied",
                "left out: a trial's chance is that of the study's seed and its number",
                "Set more trials, or the seed of the study.",
            )
        try:
            way = variants.way(path)
            must_be_apart([*self.ways.values(), way])
        except InvalidSetting as error:
            (one,) = error.mistakes
            setting = f"vary.{one.setting.removeprefix('vary.')}"
            raise _told(node.named_at, setting, one.got, one.need, one.fix) from None
        self.ways[path] = way
        axis, tried = values_of(path, node, way.leaf, self.context, at_most=at_most)
        if path in self.of_axes:
            chosen = self._chosen(axis, self.of_axes[path])
            listed = Node([chosen], chosen.place, chosen.place)
            axis, tried = values_of(path, listed, way.leaf, self.context, at_most=at_most)
        wrong: list[Mistake] = []
        for value in tried:
            if len(wrong) < _AT_ONCE:
                wrong += _tried(variants, path, value)
        if wrong:
            raise InvalidFile(*wrong)
        return axis

    def _chosen(self, axis: Listed | Drawn, node: Node) -> Node:
        """Value of an option: what its label stands for, or itself."""
        if isinstance(axis, Listed) and node.text in axis.labels:
            text = axis.texts[axis.labels.index(node.text)]
            return replace(read_tree(text, "--set"), place=node.place, named_at=node.place)
        return node

    def _beside(self, option: str, variants: Variants) -> None:
        """Refuse an option that what is varied would undo."""
        path, _ = given(option)
        try:
            way = variants.way(path)
        except InvalidSetting:
            return
        for other in self.ways.values():
            if way.meets(other):
                self.wrong.append(
                    Place("--set").mistake(
                        path,
                        got=f"set beside {other.path}, which is varied",
                        need=f"{other.path}, or a setting apart from it",
                        fix=f"Set {other.path} itself, or vary.{other.path}.",
                    )
                )

    def read_scores(self) -> None:
        """Read the scores, by their names in study files."""
        node = self.content.get("scores")
        if node is None:
            return
        kinds = Score.members()
        labels = [kind.replace("-", "_") for kind in kinds]
        if not isinstance(node.content, list) or not node.content:
            self.wrong.append(
                node.place.mistake(
                    "scores",
                    got=node.shown,
                    need=f"a list of scores: {', '.join(labels)}",
                    fix="Write [detection_probability].",
                )
            )
            return
        scores: list[Score] = []
        for index, member in enumerate(node.content):
            named = member
            if isinstance(member.content, dict):
                named = member.content.get("kind", member)
            kind = named.text.replace("_", "-")
            if kind not in kinds or not isinstance(named.content, str):
                self.wrong.append(
                    named.place.mistake(
                        f"scores.{index}",
                        got=named.shown,
                        need=f"one of {', '.join(labels)}",
                        fix=did_you_mean(named.text, labels),
                    )
                )
                continue
            inner = dict(member.content) if isinstance(member.content, dict) else {}
            inner["kind"] = replace(named, content=kind, text=kind)
            spot = Spot(f"scores.{index}", replace(member, content=inner), Slot(Score))
            with self.collected():
                scores.append(value_of(spot, self.context))
        if len(scores) == len(node.content):
            self.read["scores"] = tuple(scores)

    def study(self, seed: int | None) -> Study:
        """Read what asks about scores and points, and make the study."""
        self._read_trials()
        self._read_requirements()
        made = {**self.read, **({} if seed is None else {"seed": seed})}
        study = None
        if all(name in made for name in ("scenario", "vary", "scores")):
            try:
                study = Study(**made)
            except InvalidSetting as error:
                self.wrong += refused(error, Spot("", self.tree, Slot(Study)))
        if self.wrong or study is None:
            raise InvalidFile(*in_order(_once(self.wrong)))
        return study

    @property
    def _units(self) -> dict[str, str | None]:
        return {score.label(): unit_of(score) for score in self.read.get("scores", ())}

    def _read_trials(self) -> None:
        node = self.content.get("trials")
        if node is None:
            return
        if isinstance(node.content, dict):
            until = node.content.get("until")
            if until is not None and isinstance(until.content, dict):
                inner = self._in_si(until.content, "trials.until", ("width",), beside=1.0)
                until = replace(until, content=inner)
                node = replace(node, content={**node.content, "until": until})
        with self.collected():
            self.read["trials"] = value_of(Spot("trials", node, Slot(Trials)), self.context)

    def _read_requirements(self) -> None:
        node = self.content.get("require")
        if node is None or node.content is None:
            return
        members: list[Node] = []
        for index, member in enumerate(node.content if isinstance(node.content, list) else ()):
            inner = member.content
            if isinstance(inner, dict):
                where = f"require.{index}"
                inner = self._in_si(inner, where, ("at_least", "at_most"), beside=0.0)
                at = inner.get("at")
                if at is not None and isinstance(at.content, dict):
                    pairs = self._points(at, f"{where}.at")
                    if pairs is None:
                        continue
                    inner = {**inner, "at": pairs}
                elif at is not None and at.content is not None:
                    self.wrong.append(
                        at.place.mistake(
                            f"{where}.at",
                            got=at.shown,
                            need="a mapping of paths that are varied, and their values",
                            fix="Write at: {PATH: VALUE}.",
                        )
                    )
                    inner = {key: one for key, one in inner.items() if key != "at"}
            members.append(replace(member, content=inner))
        if isinstance(node.content, list):
            node = replace(node, content=members)
        slot = Slot(tuple[Requirement, ...])
        with self.collected():
            self.read["require"] = value_of(Spot("require", node, slot), self.context)

    def _in_si(
        self, content: dict[str, Node], where: str, names: Sequence[str], *, beside: float
    ) -> dict[str, Node]:
        """Limits of a score in its unit, to SI; what cannot be read is told, and another holds."""
        score = content.get("score")
        label = "" if score is None else score.text.replace("-", "_")
        units = self._units
        made = dict(content)
        for name in names:
            node = content.get(name)
            if node is None or node.content is None:
                continue
            number = beside
            if label in units:
                spot = Spot(f"{where}.{name}", node, Slot(float, units[label]))
                with self.collected():
                    number = value_of(spot, self.context)
            made[name] = replace(node, content=number)
        if score is not None and isinstance(score.content, str) and label in units:
            made["score"] = replace(score, content=label)
        return made

    def _points(self, at: Node, where: str) -> Node | None:
        """Pairs of path and text of the points that a requirement means.

        None where an option has taken those points away.
        """
        assert isinstance(at.content, dict)
        vary: tuple[Listed | Drawn, ...] = self.read.get("vary", ())
        pairs: list[Node] = []
        for path, node in at.content.items():
            axis = next((axis for axis in vary if axis.path == path), None)
            text = self._text_of(axis, node) if isinstance(axis, Listed) else None
            if text is not None:
                both = [replace(node, content=part, text=part) for part in (path, text)]
                pairs.append(replace(node, content=both))
            elif path in self.of_axes:
                return None
            elif "vary" in self.read:
                (one,) = wrong_at(f"{where}.{path}", path, node.text or node.shown, vary).mistakes
                place = node.place if isinstance(axis, Listed) else node.named_at
                self.wrong.append(
                    place.mistake(one.setting, got=one.got, need=one.need, fix=one.fix)
                )
        return replace(at, content=pairs)

    def _text_of(self, axis: Listed, node: Node) -> str | None:
        """Text of the value of an axis that is meant: by its label, or equal to what is given."""
        if node.text and node.text in axis.labels:
            return axis.texts[axis.labels.index(node.text)]
        slot = self.ways[axis.path].leaf
        try:
            meant = value_of(Spot(axis.path, node, slot), self.context)
        except InvalidFile:
            return None
        for text in axis.texts:
            if _same(meant, value_of(Spot(axis.path, read_tree(text, ""), slot), HERE)):
                return text
        return None

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Keep the mistakes of what is inside, and go on."""
        try:
            yield
        except DechirpError as error:
            self.wrong += error.mistakes


def _tried(variants: Variants, path: str, node: Node) -> Iterator[Mistake]:
    """Say what is wrong with a value in the scenario."""
    try:
        made = variants.of({path: line(node)})
    except DechirpError as error:
        value = shown(line(node))
        for one in error.mistakes:
            inside = one.setting == path or one.setting.startswith(f"{path}.")
            got = value if one.setting == path else one.got
            told = replace(
                one,
                setting=f"vary.{one.setting if inside else path}",
                got=got if inside else f"{value}, which makes {one.setting} {one.got}",
                need=one.need if inside else f"such that {one.setting} is {one.need}",
            )
            place = node.place
            yield replace(told, file=place.file, line=place.line, column=place.column)
        return
    assert made.scene is not None and variants.scenario.scene is not None
    if made.scene.names != variants.scenario.scene.names:
        yield node.place.mistake(
            f"vary.{path}",
            got=f"{shown(line(node))}, with targets {', '.join(made.scene.names) or 'none'}",
            need=f"with the scenario's targets: {', '.join(variants.scenario.scene.names)}",
            fix="Scores are told by target: keep the names at every point.",
        )


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9)
    return bool(one == other)


def _once(wrong: Iterable[Mistake]) -> list[Mistake]:
    """Drop what is told once more of the same place, under a longer path."""
    first: dict[tuple[object, ...], Mistake] = {}
    for one in wrong:
        first.setdefault((one.file, one.line, one.column, one.got, one.need), one)
    return list(first.values())


def _told(place: Place, setting: str, got: str, need: str, fix: str) -> InvalidFile:
    return InvalidFile(place.mistake(setting, got=got, need=need, fix=fix))
