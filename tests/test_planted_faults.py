"""The faults of `benchmarks/planted_faults.py` are planted in lines that the source has."""

import pytest
from benchmarks.planted_faults import ROOMS, planted, refuse_missing


def test_every_line_and_test_of_a_planted_fault_is_there():
    assert sum(len(list(planted(file, room))) for file, room in ROOMS.items()) > 400
    refuse_missing()


def test_a_line_that_has_changed_is_refused(monkeypatch):
    file, room = next(iter(ROOMS.items()))
    changed = type(room)(tests=room.tests, changed=(("no such line of the source", ""),))
    monkeypatch.setitem(ROOMS, file, changed)
    with pytest.raises(SystemExit, match="is there 0 times, and not once"):
        refuse_missing()
