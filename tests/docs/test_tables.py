"""Tables of the pages against the code that they speak of."""

import re
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel

from rotorfit.fit.experiment.experiment import Experiment
from rotorfit.model.parameters import DERIVED, PARAMETERS
from rotorfit.model.vehicle import LAYOUTS, layout_rotors

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def rows(page: str, first: str) -> list[list[str]]:
    """Return the cells of each row of a page whose first cell fits a pattern."""
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    return [row for row in cells if re.fullmatch(first, row[0])]


PARTS = rows("paper.md", r"P\d+")


def test_the_paper_is_there_whole():
    assert [row[0] for row in PARTS] == [f"P{i}" for i in range(1, 18)]


@pytest.mark.parametrize("row", PARTS, ids=lambda row: row[0])
def test_part_of_the_paper(row):
    _, _, functions, tests, _ = row
    source = ""
    for name in re.findall(r"`([^`]+)`", functions):
        if name.endswith(".py"):
            source = (ROOT / "src" / "rotorfit" / name).read_text(encoding="utf-8")
        else:
            assert re.search(rf"(def|class) {name.rpartition('.')[2]}\b", source), name
    found = re.findall(r"`(tests/[^`]+)`", tests)
    assert found and all((ROOT / name).is_file() for name in found)


@pytest.mark.parametrize("row", rows("conventions.md", "px4, ardupilot|betaflight|crazyflie"))
def test_motor_order_of_a_quadrotor(row):
    orders, *said = row
    places = {(1, 1): "front left", (1, -1): "front right", (-1, 1): "rear left"}
    for order in orders.split(", "):
        rotors = layout_rotors("quad-x", arm=1.0, order=order)
        signs = [tuple(np.sign(rotor.position[:2]).astype(int)) for rotor in rotors]
        where = [places.get(sign, "rear right") for sign in signs]
        assert said == [f"{w} {r.spin}" for w, r in zip(where, rotors, strict=True)]


def test_every_layout_and_parameter_is_among_the_conventions():
    page = (DOCS / "conventions.md").read_text(encoding="utf-8")
    assert [name for name, _ in LAYOUTS if f"`{name}`" not in page] == []
    assert [order for _, order in LAYOUTS if f"`{order}`" not in page] == []
    # Twins and rotors stand in one row: drag_x/y/z, kt_1 ..., Ixx_com ... Iyz_com.
    stems = {re.sub(r"(_[xyz]{1,2}|_\d+|_com|_over_kt)$", "", n) for n in PARAMETERS}
    stems |= {re.sub(r"_com$|_[xyz]$|^I.._over_kt$", "", name) for name in DERIVED} - {""}
    shown = {"Iyy", "Izz", "Ixy", "Ixz"}  # within Ixx ... Iyz
    assert [stem for stem in sorted(stems - shown) if stem not in page] == []
    assert "`Ixx_over_kt`, `Iyy_over_kt`, `Izz_over_kt`" in page


def keys_of(kind: Any) -> set[str]:
    """Return every key that an experiment file may hold, from what is read of it."""
    if not (isinstance(kind, type) and issubclass(kind, BaseModel)):
        return {key for part in get_args(kind) for key in keys_of(part)}
    fields = kind.model_fields
    return set(fields) | {key for f in fields.values() for key in keys_of(f.annotation)}


COLUMN_KEYS = {"unit", "scale", "offset", "range"}  # of a map of columns: they stand in logs.md


@pytest.mark.parametrize(
    ("file", "keys"),
    [
        ("docs/experiment.md", keys_of(Experiment) - COLUMN_KEYS),
        ("examples/experiment.toml", keys_of(Experiment) - COLUMN_KEYS),
        ("docs/logs.md", COLUMN_KEYS),
    ],
)
def test_every_key_of_an_experiment_is_reported(file, keys):
    text = (ROOT / file).read_text(encoding="utf-8")
    assert len(keys) >= 4
    assert [key for key in sorted(keys) if not re.search(rf"\b{key}\b", text)] == []
