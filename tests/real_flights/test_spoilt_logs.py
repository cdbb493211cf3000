"""Real logs spoilt by one fault each: refused, or said by name, and the documentation shows it."""

import re
from collections import Counter
from pathlib import Path

import pytest
from benchmarks.common import SOUND
from benchmarks.spoilt_logs.cases import CASES
from benchmarks.spoilt_logs.outcomes import classified, telling, told_of

PAGE = Path(__file__).parents[2] / "docs" / "spoilt-logs.md"
FAST = (
    "mass x 1.1, LOG00267",
    "a rectangle taken as a square, LOG00267",
    "accel late 30 ms, LOG00267",
)
"""Cases of each outcome that are looked at in every run, some seconds of the processor in all.

Other faults are in `doubts` and `checks` on simulated flights.
"""


SILENT: set[tuple[str, str]] = set()
"""Misses, by log and fault: numbers outside their intervals of which nothing is said."""


def outcomes():
    """Return the outcome of each case on the page, by log and fault."""
    rows = re.findall(r"^\| (\S+) \| (.+?) \| (.+?) \|", PAGE.read_text("utf-8"), re.MULTILINE)
    return {(log, fault): outcome for log, fault, outcome in rows if log in SOUND}


def test_the_page_has_every_case_and_none_is_silent():
    found = outcomes()
    assert set(found) == {(case.log, case.fault) for case in CASES}
    assert len(found) == len(CASES) >= 24
    ends = Counter(found.values())
    assert {key for key, end in found.items() if end == "SILENT"} == SILENT
    assert not {"INTERNAL ERROR", "refused, of something else"} & set(ends)
    assert f"{ends['refused']} refused" in PAGE.read_text("utf-8")


@pytest.mark.flights
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[] if case.name in FAST else pytest.mark.slow)
        for case in CASES
    ],
)
def test_a_spoilt_log_is_reported_as_the_page_says(flight_data_dir, case):
    for log in (case.log, *(flown.log for flown in case.beside)):
        if not (flight_data_dir / SOUND[log].path).is_file():
            pytest.skip(f"no {flight_data_dir / SOUND[log].path}")
    said = told_of(case, None)
    outcome = classified(case, said)
    assert (outcome == "SILENT") is ((case.log, case.fault) in SILENT), case.fault
    assert outcome == outcomes()[case.log, case.fault], telling(case, said)
