"""Certificates in docs/verification: size, table entries, quoted figures and checksums."""

import hashlib
import json
from copy import deepcopy
from pathlib import Path

import pytest

from dechirp.certificate.document import (
    PROVENANCE_KEYS,
    checksum_of_numbers,
    package_code_checksum,
)

FOLDER = Path(__file__).parents[2] / "docs" / "verification"
SUMS = dict(reversed(line.split("  ")) for line in (FOLDER / "SHA256SUMS").read_text().splitlines())
NUMBERS = sorted(name for name in SUMS if name.endswith(".json"))


def test_every_file_matches_its_stored_checksum():
    names = {path.name for path in FOLDER.iterdir()} - {"README.md", "SHA256SUMS"}
    assert names <= set(SUMS)
    # Source distributions omit the HTML pages.
    assert set(SUMS) - names in (set(), {name for name in SUMS if name.endswith(".html")})
    for name in names:
        assert hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() == SUMS[name]
        assert (FOLDER / name).stat().st_size < 1_000_000


@pytest.mark.parametrize("name", NUMBERS)
def test_certificate_passes_and_records_its_versions(name):
    certificate = json.loads((FOLDER / name).read_text())
    claims = certificate["claims"] + [
        claim for part in certificate.get("parts", []) for claim in part["claims"]
    ]

    assert certificate["passed"] and all(claim["passed"] for claim in claims)
    assert certificate["full"]
    assert {"python", "numpy", "scipy", "numba"} <= set(certificate["versions"])
    assert certificate["date"].startswith(name.removesuffix(".json"))
    assert certificate["checksum"] == checksum_of_numbers(certificate)
    table_row = next(
        line for line in (FOLDER / "README.md").read_text().splitlines() if name[:10] in line
    )
    assert f"{len(claims)} of {len(claims)} claims hold" in table_row
    assert name.replace(".json", ".html") in SUMS


def test_pages_quote_figures_of_latest_certificate():
    certificate = json.loads((FOLDER / NUMBERS[-1]).read_text())
    checks_of = {claim["id"]: claim["checks"] for claim in certificate["claims"]}
    root, guide = FOLDER.parents[1], FOLDER.parent / "guide"
    readme, limits = (root / "README.md").read_text(), (guide / "limits.md").read_text()
    noise = (guide / "phase-4-noise.md").read_text()

    rectangular, hann, rule = (
        f"{check['measured']:.2f} dB" for check in checks_of["snr_limit"][:3]
    )
    assert rectangular in readme
    assert rectangular in noise and hann in noise and rule in noise
    error_db = max(abs(check["measured"] - check["limit"]) for check in checks_of["snr_limit"][:2])
    assert f"within {error_db:.2f} dB" in noise and f"within {error_db:.2f} dB" in limits

    rare_rates = [
        check["measured"] for check in checks_of["false_alarm_rate"] if "1e-06" in check["name"]
    ]
    assert f"| {min(rare_rates):.2f} to {max(rare_rates):.2f} of the design |" in readme
    assert f"{min(rare_rates):.2f} to {max(rare_rates):.2f} of 1e-6" in limits
    detector_rates = [
        c["measured"] for part in certificate["parts"][0]["claims"] for c in part["checks"]
    ]
    assert f"({min(detector_rates):.2f} to {max(detector_rates):.2f} of the design" in readme

    errors = [
        c["measured"] / c["limit"]
        for name in ("range", "velocity")
        for c in checks_of[f"{name}_rmse"]
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


def test_checksum_ignores_provenance_and_rounding(document):
    checksum = checksum_of_numbers(document)
    assert checksum == checksum_of_numbers(json.loads(json.dumps(document)))
    for name in PROVENANCE_KEYS:
        assert checksum_of_numbers({**document, name: "other"}) == checksum
    # Rounding of another processor, and another order of keys.
    rounded = deepcopy(document)
    rounded["claims"][0]["measured"] *= 1 + 1e-12
    assert checksum_of_numbers(dict(reversed(rounded.items()))) == checksum


@pytest.mark.parametrize(
    ("field", "changed_value"),
    [("measured", 0.123458), ("trials", 11), ("id", "b"), ("interval", None)],
)
def test_checksum_changes_with_numbers(document, field, changed_value):
    checksum = checksum_of_numbers(document)
    document["claims"][0][field] = changed_value
    assert checksum_of_numbers(document) != checksum


def test_checksum_ignores_sentences(document):
    checksum = checksum_of_numbers(document)
    document["claims"][0] |= {"claim": "A sentence.", "note": "Another one."}
    assert checksum_of_numbers(document) == checksum


def test_checksum_of_fixed_document(document):
    # Canonical: {"claims":[{"id":"a","interval":["0.1",null],"measured":"0.123457",...
    text = (
        '{"claims":[{"id":"a","interval":["0.1",null],"measured":"0.123457","trials":"10"}],'
        '"passed":true,"seed":"1"}'
    )
    assert checksum_of_numbers(document) == hashlib.sha256(text.encode()).hexdigest()


def test_code_checksum_is_reproducible():
    assert package_code_checksum() == package_code_checksum()
    assert len(package_code_checksum()) == 64
