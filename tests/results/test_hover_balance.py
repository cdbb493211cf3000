"""What a hover needs of numbers that are unknown one by one is kept as the fit had it."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.results.hover_balance import (
    balance_diagnostics,
    fitted_balance,
    fitted_diagnostics,
    fitted_thrusts,
    fitted_values,
)
from rotorfit.results.validation.replay_vehicle import hover_centre, replay_vehicle

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("export", "fit")]
from export_material import COM, KT, a_result, changed, parameter

import made_fit

FITTED = {
    "kt": 2e-6,
    "kt_1": 2.2e-6,
    "kt_2": 1.8e-6,
    "msx@A": 0.004,
    "msy@A": -0.002,
    "rotor_center_x@A": 0.003,
    "com_x@A": 0.005,
    "com_y@A": -0.0025,
}


def diagnostics(*unknown):
    numbers = Numbers(
        names=tuple(FITTED),
        values=np.array(list(FITTED.values())),
        terms=made_fit.known_to(np.zeros(len(FITTED))),
        correlation=np.eye(len(FITTED)),
        excitation={},
    )
    return balance_diagnostics(numbers, FITTED.keys() - set(unknown), ["A"])


def test_the_balance_is_kept_along_the_axis_that_is_not_known():
    assert diagnostics() == {}
    both = {"balance_x@A": pytest.approx(0.002)}
    assert diagnostics("msx@A") == both
    assert diagnostics("rotor_center_x@A") == both
    # Without a centre of their own, the rotors are where they were declared.
    assert diagnostics("msy@A") == {"balance_y@A": pytest.approx(-0.0025)}


def test_the_thrust_of_an_unknown_rotor_is_kept_as_a_share():
    assert diagnostics("kt_2") == {"thrust_share_2": pytest.approx(0.9)}


def kept(result, **values):
    return replace(result, diagnostics={**result.diagnostics, **values})


def test_a_prediction_takes_the_balance_of_the_fit():
    """Whichever of the two places is unknown, their difference is that of the fit."""
    centers = (parameter("rotor_center_x", 0.02, "A"), parameter("rotor_center_y", 0.0, "A"))
    own = a_result(imu=None)
    own = kept(replace(own, parameters=(*own.parameters, *centers)), **{"balance_x@A": 0.007})
    assert fitted_balance(own, "A", "x") == 0.007
    no_center = changed(own, rotor_center_x={"value": None})
    assert hover_centre(no_center, "A") == {"rotor_center_x": pytest.approx(COM[0] - 0.007)}
    no_com = changed(own, msx={"value": None}, com_x={"value": None})
    assert hover_centre(no_com, "A") == {"com_x": pytest.approx(0.027)}
    assert hover_centre(no_center, "A", {"com_x": 0.01}) == {"rotor_center_x": pytest.approx(0.003)}


def test_a_prediction_takes_the_share_of_an_unknown_rotor():
    lost = changed(kept(a_result(), thrust_share_2=0.9), kt_2={"value": None})
    assert fitted_thrusts(kept(a_result(), thrust_share_2=0.9), {"kt": 1.0}) == {}
    assert fitted_thrusts(lost, {"kt": 1.0}) == {"kt_2": 0.9}
    assert fitted_thrusts(lost, {}) == {}
    thrust = replay_vehicle(lost, "A", draws=3).thrust[:, :, 2]
    assert thrust[0, 1] == pytest.approx(0.9 * KT)
    # The share stays where kt moves.
    np.testing.assert_allclose(thrust[:, 1] / thrust[:, 0], thrust[0, 1] / thrust[0, 0], rtol=0.1)
    assert replay_vehicle(lost, "A", assumed={"kt": KT}).thrust[0, 1, 2] == pytest.approx(KT)


def test_unknown_heights_are_kept_as_the_flights_show_them():
    """The best linear prediction of a height: a quarter of the arm before the flight."""
    flown = made_fit.configuration()
    usual = 0.25 * flown.mass * made_fit.ARM
    for std, share in ((1e-6 * usual, 1.0), (usual, 0.5), (10.0 * usual, 1.0 / 101.0)):
        estimate = made_fit.fit_of([flown], std={"msz@A": std}, terms=["rotor_drag"]).estimate
        found = fitted_diagnostics(estimate, [flown], {"kt"}, measured=True)
        assert found["fitted_msz@A"] == pytest.approx(share * made_fit.BODY["msz"])
    assert found["fitted_rotor_drag"] == made_fit.BODY["rotor_drag"]
    # Msx and msy are the balance's, and coefficients over commands get other units.
    assert not {"fitted_kt", "fitted_msx@A"} & found.keys()
    known = {"msz@A"}
    assert (
        not {"fitted_msz@A", "fitted_rotor_drag"}
        & fitted_diagnostics(estimate, [flown], known, measured=False).keys()
    )


def test_fitted_values_are_those_of_a_configuration():
    own = kept(a_result(), **{"fitted_msz@A": 0.1, "fitted_msz@B": 0.2, "fitted_mounting_x": 0.3})
    assert fitted_values(own, "A") == {"msz": 0.1, "mounting_x": 0.3}
