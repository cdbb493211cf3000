"""The command line in process, and the files that its tests begin with."""

import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from rotorfit.cli.main import main

Columns = dict[str, np.ndarray]

AIRFRAME = """[airframe]
layout = "quad-plus"
arm = 0.2
order = "paper"
imu = { position = [0.0, 0.0, 0.0] }
"""
EXPERIMENT = f"""{AIRFRAME}
[identification]
method = "ols"

[[configuration]]
mass = 1.285
flights = ["flight.csv"]
"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a command ended, and what it printed."""

    code: int
    out: str
    err: str

    @property
    def json(self):
        return json.loads(self.out)


def called(*arguments: object) -> int:
    """Run the command line in this process and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments)])
    code = ended.value.code
    return code if isinstance(code, int) else 0


def without(*beginnings: str) -> Callable[[Columns], Columns]:
    """Return what leaves the columns out that begin so."""
    return lambda c: {n: v for n, v in c.items() if not n.startswith(beginnings)}
