"""Findings withhold numbers: those known as a ratio are still told as one."""

import numpy as np

from rotorfit.findings import Finding
from rotorfit.results.assemble import with_diagnosis
from rotorfit.results.result import Derived, IdentificationResult, Parameter


def a_number(name, value, **more):
    return {"name": name, "configuration": None if name in ("kt", "kd") else "A", "value": value,
            "std": 0.1, "interval": (value - 0.2, value + 0.2), "unit": "", **more}  # fmt: skip


def test_the_scale_of_yaw_is_withheld_and_its_ratio_stays():
    parameters = tuple(
        Parameter(**a_number(name, 1.0, verdict="identified")) for name in ("kt", "kd", "Izz")
    )
    result = IdentificationResult(
        name="made",
        method="banded",
        parameters=parameters,
        derived=tuple(Derived(**a_number(name, 2.0)) for name in ("Izz_com", "kd_over_Izz")),
        flights=(),
        covariance_names=("kt", "kd", "Izz@A"),
        covariance=np.eye(3),
        settings={},
        versions={},
    )
    finding = Finding(
        kind="no-coupling",
        severity="doubt",
        sentence="none affects another",
        numbers=("kd", "Izz@A", "Izz_com@A"),
        next_step="take it from a pendulum",
        withheld_because="no coupling",
    )
    found = with_diagnosis(result, [finding])
    kt, kd, Izz = found.parameters
    assert kt == parameters[0]
    for p, partner in ((kd, "Izz"), (Izz, "kd")):
        assert (p.value, p.verdict, p.partner) == (None, "ratio-only", partner)
        assert (p.reason, p.advice) == ("no coupling", "take it from a pendulum")
    assert [d.value for d in found.derived] == [None, 2.0]
    assert found.covariance_names == ("kt",)
    assert found.warnings == ("none affects another",)
