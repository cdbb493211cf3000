"""SciPy does not load what it only names of NumPy, and what is postponed works."""

import subprocess
import sys

import pytest

LOADED = "numpy.f2py.crackfortran", "numpy.testing._private.utils", "numpy.ma.core"
PROGRAM = """
import sys
from rotorfit.cli.postponed_imports import postpone_imports
{first}
import scipy.linalg
import scipy.special
print(*[name for name in {loaded!r} if name in sys.modules])
{then}
print(*[name for name in {loaded!r} if name in sys.modules])
"""


def loaded_modules(first: str, then: str = "") -> list[list[str]]:
    """Return which modules are loaded after SciPy, and after `then`."""
    program = PROGRAM.format(first=first, then=then, loaded=LOADED)
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return [line.split() for line in run.stdout.splitlines()]


def test_scipy_loads_no_parser_of_fortran() -> None:
    assert loaded_modules("postpone_imports()") == [[], []]


@pytest.mark.parametrize(
    ("use", "loads"),
    [
        ("import numpy.testing; numpy.testing.assert_allclose(1.0, 1.0)", LOADED[1]),
        ("import numpy as np; assert np.ma.masked_equal([1, 2], 2).sum() == 1", LOADED[2]),
        ("from numpy.f2py import run_main; assert callable(run_main)", LOADED[0]),
        ("import scipy.stats; assert scipy.stats.norm.cdf(0.0) == 0.5", LOADED[2]),
    ],
)
def test_what_is_postponed_is_there_when_it_is_used(use: str, loads: str) -> None:
    before, after = loaded_modules("postpone_imports(); postpone_imports()", use)
    assert before == []
    assert loads in after


def test_what_is_loaded_already_stays() -> None:
    assert LOADED[2] in loaded_modules("import numpy.ma.core; postpone_imports()")[0]
