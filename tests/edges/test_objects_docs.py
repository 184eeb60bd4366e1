"""Documentation page on object lists: signal table and sizes of datagrams match the code."""

import re
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.results.object_lists.can_layout import OBJECT_SIGNALS, read_dbc_layout
from dechirp.results.object_lists.ethernet import MAX_OBJECTS_PER_LIST, encode_datagrams
from sample_object_lists import longest_object_list

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


def test_documented_sizes_of_datagrams_match_messages():
    documented = {
        name: int(re.search(pattern, PAGE).group(1))
        for name, pattern in {
            "header": r"about (\d+) bytes, and up to",
            "object": r"up to (\d+) for each object",
            "packet": r"messages above (\d+) bytes",
            "objects in a packet": r"messages above \d+ bytes, (\d+) objects",
            "datagram": r"up to (\d+) bytes, and OSI",
            "objects": r"more than (\d+) objects",
        }.items()
    }
    n_objects = (0, 1, documented["objects in a packet"], documented["objects in a packet"] + 1)
    empty, single, fits, exceeds = (
        len(encode_datagrams(longest_object_list("detection", n))[0]) for n in n_objects
    )

    assert documented["header"] == pytest.approx(empty, abs=10)
    assert documented["object"] == single - empty
    assert fits <= documented["packet"] == 1500 - 20 - 8 < exceeds
    assert documented["datagram"] == 2**16 - 1 - 20 - 8
    assert documented["objects"] == MAX_OBJECTS_PER_LIST
