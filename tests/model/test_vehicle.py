"""What is no rotor is refused where it is made."""

import subprocess
import sys

import pytest

from rotorfit.errors import ExperimentError
from rotorfit.model.vehicle import Rotor


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": (0.1, 0.2, float("nan"))}, r"position is .*, expected three numbers"),
        ({"axis": (0.0, 0.0, 2.0)}, "expected a unit vector: divide it by its length"),
        ({"axis": (0.0, 0.0, 0.0)}, "expected a unit vector"),
    ],
)
def test_what_is_no_rotor_is_refused(change, words):
    sound = {"position": (0.1, 0.2, 0.0), "spin": "ccw"}
    assert Rotor(**sound).axis == (0.0, 0.0, 1.0)
    with pytest.raises(ExperimentError, match=words):
        Rotor(**{**sound, **change})


WRONG_KINDS = """
from rotorfit import ExperimentError, Rotor
for change in ({"position": (0.1, 0.2)}, {"spin": "left"}, {"axis": (0.0, 1.0)}):
    try:
        Rotor(**{"position": (0.1, 0.2, 0.0), "spin": "ccw", **change})
    except ExperimentError as error:
        print(error)
"""


def test_wrong_kinds_are_refused_in_words(assert_text):
    """In a process of its own: the tests' checks of types would come first."""
    ended = subprocess.run(
        [sys.executable, "-c", WRONG_KINDS], capture_output=True, text=True, check=True
    )
    assert_text(ended.stdout.splitlines())
