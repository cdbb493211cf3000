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


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="write the golden files anew")
    parser.addoption("--update-pictures", action="store_true", help="take the screenshots anew")


@pytest.fixture
def golden(request: pytest.FixtureRequest):
    """Compare a text with a file of tests/golden, or write it there with --update-golden."""
    folder = Path(__file__).parent / "golden"

    def compare(name: str, text: str) -> None:
        path = folder / name
        if request.config.getoption("--update-golden"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
        if not path.exists():
            pytest.fail(f"no {path}: make it with  pytest --update-golden")
        expected = path.read_text(encoding="utf-8")
        assert text == expected, "meant so? then  pytest --update-golden"

    return compare
