"""Folders of the real recordings, which are not part of the project: most have no licence."""

import os
from pathlib import Path

import pytest


def find_data_folder(variable: str, name: str) -> Path:
    """Return a folder of recordings, from an environment variable or next to the checkout."""
    configured_folder = os.environ.get(variable)
    checkout = Path(__file__).resolve().parents[2]
    folder = (
        Path(configured_folder) if configured_folder else checkout.parent / "shared" / "data" / name
    )
    if folder.is_dir():
        return folder
    reason = f"no recordings in {folder}; name their folder in {variable}"
    if os.environ.get("CI") and configured_folder:
        pytest.fail(f"{reason} (with CI set, a folder that is named must exist)")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of recordings with their settings and truth."""
    return find_data_folder("DECHIRP_REAL_DATA", "real")


@pytest.fixture(scope="session")
def witness_data() -> Path:
    """Return the folder of recordings and vendors' test vectors with known answers."""
    return find_data_folder("DECHIRP_WITNESS_DATA", "witness")
