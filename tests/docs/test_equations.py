"""The equations that theory.md shows, as they are written there, are those of the model."""

import re
from pathlib import Path

import numpy as np
import pytest

THEORY = (Path(__file__).parents[2] / "docs" / "theory.md").read_text(encoding="utf-8")
FORMULAS = [text.strip() for text in re.findall(r"\$\$(.*?)\$\$", THEORY, re.S)]
AXES = "xyz"


def formula(beginning: str) -> str:
    found = [text for text in FORMULAS if text.startswith(beginning)]
    assert len(found) == 1, beginning
    return found[0]


def as_python(latex: str) -> str:
    """Translate sums of products of inertia elements and rates, the only formulas read here."""
    text = re.sub(r"\\dot\\omega *\{\}_([xyz])", r" dw\1 ", latex)
    text = re.sub(r"\\omega_([xyz])\^2", r" w\1 * w\1 ", text)
    text = re.sub(r"\\omega_([xyz])", r" w\1 ", text)
    text = re.sub(r"I(?:\^C)?_\{([xyz]{2})\}", r" I\1 ", text).replace(r"\,", " ")
    text = re.sub(r"(?<=[a-z)]) +(?=[a-zI(])", " * ", text)
    return re.sub(r"\s+", " ", text).strip()


def values(inertia: np.ndarray, rates: np.ndarray, accelerations: np.ndarray) -> dict[str, float]:
    names = {f"I{AXES[i]}{AXES[j]}": float(inertia[i, j]) for i in range(3) for j in range(i, 3)}
    names |= {f"w{axis}": float(w) for axis, w in zip(AXES, rates, strict=True)}
    return names | {f"dw{axis}": float(a) for axis, a in zip(AXES, accelerations, strict=True)}


def euler(inertia: np.ndarray, rates: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
    return inertia @ accelerations + np.cross(rates, inertia @ rates)


@pytest.fixture(params=range(3))
def motion(request) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(request.param)
    half = random.normal(size=(3, 3))
    return half @ half.T, random.normal(size=3), random.normal(size=3)


def test_yaw_row_about_the_centre_of_mass(motion):
    left, right = formula("I^C_{zz}").rstrip(" .").split("=")
    assert right.strip() == r"k_d\,S"
    assert eval(as_python(left), values(*motion)) == pytest.approx(euler(*motion)[2], rel=1e-12)


def test_rows_of_a_symmetric_vehicle(motion):
    inertia, rates, accelerations = motion
    inertia = np.diag(np.diag(inertia))
    inertia[1, 1] = inertia[0, 0]  # symmetric: roll like pitch
    rows = [row.split("=")[0] for row in formula("I_{xx}").split(r"\quad")]
    shown = [eval(as_python(row), values(inertia, rates, accelerations)) for row in rows]
    assert shown == pytest.approx(euler(inertia, rates, accelerations), rel=1e-12)
