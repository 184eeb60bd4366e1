"""Folder of the real recordings, which are not part of the project: most have no licence."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of recordings, from DECHIRP_REAL_DATA or next to the checkout."""
    configured_folder = os.environ.get("DECHIRP_REAL_DATA")
    checkout = Path(__file__).resolve().parents[2]
    folder = (
        Path(configured_folder)
        if configured_folder
        else checkout.parent / "shared" / "data" / "real"
    )
    if folder.is_dir():
        return folder
    reason = f"no recordings in {folder}; name their folder in DECHIRP_REAL_DATA"
    if os.environ.get("CI"):
        pytest.fail(f"{reason} (with CI set, these tests must run)")
    pytest.skip(reason)
