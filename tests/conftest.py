"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def flight_data_dir() -> Path:
    """Folder of the real logs: $ROTORFIT_DATA, or ../shared/data beside the repository."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("ROTORFIT_DATA") or default)
    if not folder.is_dir():
        pytest.skip(f"no flight data in {folder}: set ROTORFIT_DATA")
    return folder
