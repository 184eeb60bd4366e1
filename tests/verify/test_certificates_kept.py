"""Certificates in docs/verification: whole, small, in the table, and true to their checksums."""

import hashlib
import json
from copy import deepcopy
from pathlib import Path

import pytest

from dechirp.certificate.checksum import (
    PROVENANCE_KEYS,
    _json_digest,
    code_checksum,
    number_checksum,
)

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
    if name == "2026-11-23.json":  # its checksum covers the sentences, too
        results = {key: found[key] for key in found if key not in PROVENANCE_KEYS}
        assert found["checksum"] == _json_digest(results)
    else:
        assert found["checksum"] == number_checksum(found)
    of_table = next(
        line for line in (FOLDER / "README.md").read_text().splitlines() if name[:10] in line
    )
    assert f"{len(claims)} of {len(claims)} claims hold" in of_table
    assert name.replace(".json", ".html") in SUMS


def test_pages_tell_the_figures_of_the_last_certificate():
    found = json.loads((FOLDER / NUMBERS[-1]).read_text())
    of = {claim["id"]: claim["checks"] for claim in found["claims"]}
    home, guide = FOLDER.parents[1], FOLDER.parent / "guide"
    readme, limits = (home / "README.md").read_text(), (guide / "limits.md").read_text()
    noise = (guide / "phase-4-noise.md").read_text()

    rectangular, hann, rule = (f"{check['measured']:.2f} dB" for check in of["snr_limit"])
    assert rectangular in readme
    assert rectangular in noise and hann in noise and rule in noise
    off = max(abs(check["measured"] - check["limit"]) for check in of["snr_limit"][:2])
    assert f"within {off:.2f} dB" in noise and f"within {off:.2f} dB" in limits

    rare = [check["measured"] for check in of["false_alarm_rate"] if "1e-06" in check["name"]]
    assert f"| {min(rare):.2f} to {max(rare):.2f} of the design |" in readme
    assert f"{min(rare):.2f} to {max(rare):.2f} of 1e-6" in limits
    every = [c["measured"] for one in found["parts"][0]["claims"] for c in one["checks"]]
    assert f"({min(every):.2f} to {max(every):.2f} of the design" in readme

    errors = [
        c["measured"] / c["limit"] for name in ("range", "velocity") for c in of[f"{name}_rmse"]
    ]
    assert f"| {min(errors):.2f} to {max(errors):.2f} of it |" in readme
    assert f"{min(errors):.2f} to {max(errors):.2f} of the Cramér-Rao bound" in limits


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
    before = number_checksum(document)
    assert before == number_checksum(json.loads(json.dumps(document)))
    for name in PROVENANCE_KEYS:
        assert number_checksum({**document, name: "other"}) == before
    # Rounding of another processor; the order of names.
    near = deepcopy(document)
    near["claims"][0]["measured"] *= 1 + 1e-12
    assert number_checksum(dict(reversed(near.items()))) == before


@pytest.mark.parametrize(
    ("field", "other"), [("measured", 0.123458), ("trials", 11), ("id", "b"), ("interval", None)]
)
def test_another_number_has_another_checksum(document, field, other):
    before = number_checksum(document)
    document["claims"][0][field] = other
    assert number_checksum(document) != before


def test_the_checksum_does_not_depend_on_sentences(document):
    before = number_checksum(document)
    document["claims"][0] |= {"claim": "A sentence.", "note": "Another one."}
    assert number_checksum(document) == before


def test_the_checksum_of_one_document_is_this_one(document):
    # Canonical: {"claims":[{"id":"a","interval":["0.1",null],"measured":"0.123457",...
    text = (
        '{"claims":[{"id":"a","interval":["0.1",null],"measured":"0.123457","trials":"10"}],'
        '"passed":true,"seed":"1"}'
    )
    assert number_checksum(document) == hashlib.sha256(text.encode()).hexdigest()


def test_the_code_has_one_checksum():
    assert code_checksum() == code_checksum()
    assert len(code_checksum()) == 64
