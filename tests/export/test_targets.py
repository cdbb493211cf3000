"""The table of targets: whole, known to the documentation, and light to import."""

import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

from rotorfit.export.targets import (
    OFFERED,
    RANDOM_TARGETS,
    TARGETS,
    RandomTargetName,
    TargetName,
    writer_of,
)
from rotorfit.model.parameters import COM, INERTIA_COM, PARAMETERS

PAGE = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")


def test_the_table_has_every_name():
    assert tuple(TARGETS) == get_args(TargetName)
    assert tuple(RANDOM_TARGETS) == get_args(RandomTargetName)


@pytest.mark.parametrize("target", OFFERED)
def test_a_target_has_a_writer_and_a_row_in_the_docs(target):
    assert writer_of(target).__name__ == f"write_{target.replace('-', '_')}"
    assert f"| `{target}` |" in PAGE
    assert OFFERED[target].consumer.lower() in PAGE.lower()


def test_the_needed_numbers_are_names_of_the_model():
    known = {*PARAMETERS, *COM, *INERTIA_COM, "max_speed"}
    assert {name for target in OFFERED.values() for name in target.needs} <= known


def test_the_table_is_known_without_numpy():
    code = "import sys, rotorfit.export.targets; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
