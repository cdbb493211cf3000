"""Vehicles from the joint posterior: its mean and covariance, physical one by one."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rotorfit.errors import EstimationError
from rotorfit.model.parameters import COM, INERTIA, PARAMETERS, inertia_about, inertia_matrix
from rotorfit.results.result import IdentificationResult, Parameter

MASS, HEIGHT = 1.2, np.array([0.01, -0.005, 0.02])
ABOUT_COM = np.array([0.018, 0.019, 0.03, 0.0002, -0.0003, 0.0001])
DRAWN = ("kt", "kd", "msx", "msy", "msz", *INERTIA)


def a_result(*, relative: float = 0.01, inertia: np.ndarray = ABOUT_COM) -> IdentificationResult:
    """A result with a full covariance of correlations up to 0.9, and a lag that stands apart."""
    origin = inertia_about(inertia, MASS, HEIGHT)
    values = np.array([3.6e-6, 5e-8, *(MASS * HEIGHT), *origin])
    scale = np.array([*values[:2], *[0.02] * 3, *[origin[0]] * 6])
    mix = np.random.default_rng(5).normal(size=(len(DRAWN), len(DRAWN)))
    together = mix @ mix.T
    size = np.sqrt(np.diag(together))
    covariance = together / np.outer(size, size) * np.outer(scale, scale) * relative**2
    fields: dict[str, Any] = {"interval": (0.0, 1.0), "verdict": "identified"}
    own = [
        Parameter(
            name=name,
            configuration=None if name in ("kt", "kd") else "A",
            value=float(value),
            std=float(std),
            unit=PARAMETERS[name].unit,
            **fields,
        )
        for name, value, std in zip(DRAWN, values, np.sqrt(np.diag(covariance)), strict=True)
    ]
    own += [
        Parameter(name="mass", configuration="A", value=MASS, std=None, unit="kg",
                  **fields | {"verdict": "given", "interval": None}),
        Parameter(name="motor_lag", configuration=None, value=0.04, std=0.002, unit="s", **fields),
        Parameter(name="Jr", configuration=None, value=None, std=None, unit="kg m^2",
                  **fields | {"verdict": "not-identified", "interval": None}),
    ]  # fmt: skip
    return IdentificationResult(
        name="drawn",
        method="banded",
        parameters=tuple(own),
        derived=(),
        flights=(),
        covariance_names=tuple(p.full_name for p in own[: len(DRAWN)]),
        covariance=covariance,
        settings={},
        versions={},
    )


COUNT = 20000
"""Of samples: a mean is off by 1/141 of a deviation, a variance by 1 %, a correlation by 0.7 %."""


def test_mean_and_covariance_are_those_of_the_result():
    result = a_result()
    drawn = result.samples(COUNT, 3)
    stacked = np.stack([drawn.values[name] for name in DRAWN])
    mean = np.array([result.parameter(name).value for name in DRAWN])
    std = np.sqrt(np.diag(result.covariance))
    assert drawn.rejected == 0.0
    assert (np.abs(stacked.mean(axis=1) - mean) / std).max() < 0.03
    found = np.cov(stacked) / np.outer(std, std)
    assert np.abs(found - result.covariance / np.outer(std, std)).max() < 0.05
    assert drawn.values["motor_lag"].std() == pytest.approx(0.002, rel=0.03)


def test_inertia_about_the_com_is_that_of_each_vehicle():
    drawn = a_result().samples(50)
    for i in range(len(drawn)):
        com = np.array([drawn.values[name][i] for name in COM])
        own = np.array([drawn.values[f"{name}_com"][i] for name in INERTIA])
        origin = np.array([drawn.values[name][i] for name in INERTIA])
        np.testing.assert_allclose(inertia_about(own, MASS, com), origin, rtol=1e-12)


def test_every_vehicle_can_exist_and_the_rejected_share_is_said(assert_wording):
    # Izz nearly the sum of the others: half of what is drawn is no body.
    flat = np.array([0.018, 0.019, 0.0369, 0.0, 0.0, 0.0])
    drawn = a_result(inertia=flat, relative=0.02).samples(2000, 1)
    for i in range(len(drawn)):
        elements = np.array([drawn.values[f"{name}_com"][i] for name in INERTIA])
        moments = np.linalg.eigvalsh(inertia_matrix(elements))
        assert moments[0] > 0.0
        assert moments[2] <= moments[0] + moments[1]
    assert 0.3 < drawn.rejected < 0.7
    assert drawn.reasons == {"a body with that inertia": drawn.rejected}
    assert f"{100 * drawn.rejected:.2g} %" in str(drawn)
    assert_wording(str(drawn))


def test_what_is_fixed_and_what_is_missing_is_said():
    drawn = a_result().samples(5)
    assert drawn.fixed == ("mass",)
    assert drawn.missing == ("Jr",)
    assert set(drawn.values["mass"]) == {MASS}
    assert drawn.units["Ixx_com"] == "kg m^2" and drawn.units["com_x"] == "m"


def test_a_seed_reproduces_vehicles_and_more_extend_the_sequence():
    result = a_result()
    a, b, more = result.samples(10, 7), result.samples(10, 7), result.samples(5000, 7)
    np.testing.assert_array_equal(a.values["kt"], b.values["kt"])
    np.testing.assert_array_equal(a.values["kt"], more.values["kt"][:10])
    assert not np.array_equal(a.values["kt"], result.samples(10, 8).values["kt"])


def test_a_result_far_from_any_body_is_refused():
    far = np.array([0.018, 0.019, 0.06, 0.0, 0.0, 0.0])
    with pytest.raises(EstimationError, match=r"hardly one .*with that inertia: 100 %"):
        a_result(inertia=far).samples(10)


def test_an_unknown_mass_is_refused():
    result = a_result()
    parts = [replace(p, value=None) if p.name == "mass" else p for p in result.parameters]
    with pytest.raises(EstimationError, match=r"mass is unknown.*identify again with --mass"):
        replace(result, parameters=tuple(parts)).samples(10)
    with pytest.raises(ValueError, match="0 samples; expected 1 or more"):
        result.samples(0)
