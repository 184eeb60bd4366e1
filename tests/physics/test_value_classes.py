"""Value classes compare, hash and print as Python's own dataclasses."""

import math
from dataclasses import field, make_dataclass

import pytest

from dechirp.core.values import frozen_dataclass

CONTENTS = {"x_m": math.nan, "pair": (1, "b"), "hidden": "unseen", "other": None}


@pytest.mark.parametrize("n_fields", range(len(CONTENTS) + 1))
def test_values_compare_hash_and_print_as_dataclasses(n_fields):
    values = dict(list(CONTENTS.items())[:n_fields])
    fields = [
        (name, object, field(compare=name != "hidden", repr=name != "hidden")) for name in values
    ]
    plain = make_dataclass("Sample", fields, frozen=True, kw_only=True)
    bare = type(
        "Sample",
        (),
        {
            "__annotations__": {name: object for name, *_ in fields},
            **{name: f for name, _, f in fields},
        },
    )
    ours = frozen_dataclass(bare)

    for change in ({}, *({name: "changed"} for name in values)):
        # As in tuples, NaN equals itself only as the same object.
        assert (ours(**values | change) == ours(**values)) == (
            plain(**values | change) == plain(**values)
        )
        assert (hash(ours(**values | change)) == hash(ours(**values))) == (
            hash(plain(**values | change)) == hash(plain(**values))
        )
    assert repr(ours(**values)) == repr(plain(**values)).replace(
        plain.__qualname__, ours.__qualname__
    )
    assert ours(**values) != plain(**values)


def test_value_that_contains_itself_has_a_text():
    node = frozen_dataclass(type("Node", (), {"__annotations__": {"children": list}}))(children=[])
    node.children.append(node)

    assert repr(node) == "Node(children=[...])"
