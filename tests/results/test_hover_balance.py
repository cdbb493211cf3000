"""What a hover needs of numbers that are unknown one by one is kept as the fit had it."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.results.hover_balance import balance_diagnostics, fitted_balance, fitted_thrusts
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
