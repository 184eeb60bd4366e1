"""Documentation page on object lists: signal table and datagram layout match the code."""

import re
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.results.object_lists import datagrams
from dechirp.results.object_lists.can_layout import OBJECT_SIGNALS, read_dbc_layout

PAGE = (Path(dc.__file__).parents[2] / "docs" / "objects.md").read_text(encoding="utf-8")


def parse_signal_table() -> dict[str, tuple[float, ...]]:
    rows = re.findall(r"^\| (\w+) \| (\d+) \| (\S+) \| (\S+) \| (\S+) \|", PAGE, re.MULTILINE)
    return {name: tuple(float(number) for number in numbers) for name, *numbers in rows}


def test_documented_signals_match_dbc_range_and_step():
    layout = read_dbc_layout()
    messages = (*layout.header.signals, *layout.part.signals)
    bits = {signal.name.removesuffix("_0"): signal.length for signal in messages}

    assert parse_signal_table() == {
        name: pytest.approx((bits[name], codes.min_value, codes.max_value, codes.scale))
        for name, codes in layout.codes.items()
        if name != "Part"
    }
    assert set(OBJECT_SIGNALS) < set(parse_signal_table())


def test_documented_datagram_layout_matches_docstring():
    rows = [line for line in datagrams.__doc__.splitlines() if re.match(r"\| \d+ \|", line)]
    assert len(rows) == 14
    page_rows = [re.sub(r"the whole datagram", "the datagram", line) for line in rows]
    assert all(line in PAGE for line in page_rows)
