"""Certificates in docs/verification: whole, small, in the table, and true to their checksums."""

import hashlib
import json
from copy import deepcopy
from pathlib import Path

import pytest

from dechirp.experiment.verify.checksum import NOT_NUMBERS, of_code, of_numbers

FOLDER = Path(__file__).parents[2] / "docs" / "verification"
SUMS = dict(reversed(line.split("  ")) for line in (FOLDER / "SHA256SUMS").read_text().splitlines())
NUMBERS = sorted(name for name in SUMS if name.endswith(".json"))


def test_every_file_has_the_checksum_that_stands_beside_it():
    kept = {path.name for path in FOLDER.iterdir()} - {"README.md", "SHA256SUMS"}
    assert kept <= set(SUMS)
    # Packed sources leave the pages out.
    assert set(SUMS) - kept in (set(), {name for name in SUMS if name.endswith(".html")})
    for name in kept:
        assert hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() == SUMS[name]
        assert (FOLDER / name).stat().st_size < 1_000_000


@pytest.mark.parametrize("name", NUMBERS)
def test_a_certificate_holds_and_says_what_it_rests_on(name):
    found = json.loads((FOLDER / name).read_text())
    claims = found["claims"] + [one for part in found.get("parts", []) for one in part["claims"]]

    assert found["passed"] and all(claim["passed"] for claim in claims)
    assert found["full"]
    assert {"python", "numpy", "scipy", "numba"} <= set(found["versions"])
    assert found["date"].startswith(name.removesuffix(".json"))
    if "checksum" in found:  # none before there were parts
        assert found["checksum"] == of_numbers(found)
    else:
        assert name == "2026-11-21.json"
    of_table = next(
        line for line in (FOLDER / "README.md").read_text().splitlines() if name[:10] in line
    )
    assert f"{len(claims)} of {len(claims)} claims hold" in of_table
    assert name.replace(".json", ".html") in SUMS


@pytest.fixture
def document():
    return {
        "date": "2026-01-02T03:04:05+00:00",
        "machine": "one",
        "seed": 1,
        "passed": True,
        "claims": [{"id": "a", "measured": 0.123456789012, "interval": [0.1, None], "trials": 10}],
    }


def test_the_checksum_is_of_the_numbers_alone(document):
    before = of_numbers(document)
    assert before == of_numbers(json.loads(json.dumps(document)))
    for name in NOT_NUMBERS:
        assert of_numbers({**document, name: "other"}) == before
    # Rounding of another processor; the order of names.
    near = deepcopy(document)
    near["claims"][0]["measured"] *= 1 + 1e-12
    assert of_numbers(dict(reversed(near.items()))) == before


@pytest.mark.parametrize(
    ("field", "other"), [("measured", 0.123458), ("trials", 11), ("id", "b"), ("interval", None)]
)
def test_another_number_has_another_checksum(document, field, other):
    before = of_numbers(document)
    document["claims"][0][field] = other
    assert of_numbers(document) != before


def test_the_checksum_of_one_document_is_this_one(document):
    # Canonical: {"claims":[{"id":"a","interval":["0.1",null],"measured":"0.123457",...
    text = (
        '{"claims":[{"id":"a","interval":["0.1",null],"measured":"0.123457","trials":"10"}],'
        '"passed":true,"seed":"1"}'
    )
    assert of_numbers(document) == hashlib.sha256(text.encode()).hexdigest()


def test_the_code_has_one_checksum():
    assert of_code() == of_code()
    assert len(of_code()) == 64
