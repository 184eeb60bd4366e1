"""Value classes compare, hash and print as Python's own dataclasses."""

import math
from dataclasses import field, make_dataclass

import pytest

from dechirp.core.values import frozen_dataclass

CONTENTS = {"x_m": 2.5, "pair": (1, "b"), "hidden": "unseen", "other": None}


def test_nan_equals_itself_as_the_same_object_only():
    """As in tuples, and in dataclasses up to Python 3.12."""
    sample = frozen_dataclass(type("Sample", (), {"__annotations__": {"x_m": float}}))

    assert sample(x_m=math.nan) == sample(x_m=math.nan)
    assert sample(x_m=math.nan) != sample(x_m=float("nan"))


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
