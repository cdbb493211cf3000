"""What an interval is made of: the parts of the study add up to it."""

import warnings

import numpy as np
import pytest
from benchmarks.real_flights import cases
from benchmarks.widths import Widths, fitted, table, widths


def test_parts_of_a_throw_add_up_to_its_intervals(flight_data_dir, tmp_path):
    path = tmp_path / "throw.toml"
    (throw,) = [case for case in cases(flight_data_dir) if case.name == "cinerat 271"]
    path.write_text(throw.declaration, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = widths(fitted(path))
    inside = ("likelihood", "own blocks", "blocks", "phases")
    squares = [part**2 for name, part in found.parts.items() if name not in inside]
    known = np.isfinite(found.half_width)
    np.testing.assert_allclose(
        np.sqrt(np.sum(squares, axis=0))[known], found.half_width[known], rtol=1e-9
    )
    assert np.all(found.parts["noise"] >= found.parts["blocks"])
    at = found.names.index("Izz_com@A")
    assert found.blocks[at] == pytest.approx(1.6, abs=0.1)
    assert found.half_width[at] / found.values[at] == pytest.approx(0.067, abs=0.01)


def test_a_table_is_in_percent_with_medians_last():
    halves = ((4.0, 3.0, 2.0), (8.0, 8.0, 3.0))
    made = [
        Widths(
            names=("kd",),
            values=np.array([-200.0]),
            half_width=np.array([half]),
            parts={"noise": np.array([chance]), "push": np.zeros(1)},
            blocks=np.array([blocks]),
        )
        for half, chance, blocks in halves
    ]
    lines = [line.split() for line in table(zip(("one", "two"), made, strict=True), "kd")]
    assert lines[0] == ["kd", "half", "noise", "tell", "share"]
    assert lines[1] == ["one", "2.00", "1.50", "2.00", "0.56"]
    assert lines[3] == ["median", "3.00", "2.75", "2.50", "0.78"]
