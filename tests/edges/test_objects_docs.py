"""What the page on object lists says is so."""

import re
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.results.object_lists import datagrams
from dechirp.results.object_lists.can_layout import OBJECT_SIGNALS, read_layout

PAGE = (Path(dc.__file__).parents[2] / "docs" / "objects.md").read_text(encoding="utf-8")


def signals() -> dict[str, tuple[float, ...]]:
    rows = re.findall(r"^\| (\w+) \| (\d+) \| (\S+) \| (\S+) \| (\S+) \|", PAGE, re.MULTILINE)
    return {name: tuple(float(number) for number in numbers) for name, *numbers in rows}


def test_the_page_has_every_signal_of_the_dbc_with_its_range_and_step():
    found = read_layout()
    messages = (*found.header.signals, *found.part.signals)
    bits = {signal.name.removesuffix("_0"): signal.length for signal in messages}

    assert signals() == {
        name: pytest.approx((bits[name], codes.min_value, codes.max_value, codes.scale))
        for name, codes in found.codes.items()
        if name != "Part"
    }
    assert set(OBJECT_SIGNALS) < set(signals())


def test_the_page_has_the_layout_of_datagrams_as_the_code_says_it():
    told = [line for line in datagrams.__doc__.splitlines() if re.match(r"\| \d+ \|", line)]
    assert len(told) == 14
    said = [re.sub(r"the whole datagram", "the datagram", line) for line in told]
    assert all(line in PAGE for line in said)
