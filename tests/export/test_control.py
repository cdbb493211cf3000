"""What controllers ask of a vehicle: INDI's G1 and G2, newton per unit of PX4's setpoints."""

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from export_material import (
    INERTIA_COM,
    KD,
    KT,
    MASS,
    ROTORS,
    SPEEDS,
    UNKNOWN,
    a_result,
    body_of,
    changed,
    flat,
    motion,
    not_identified,
    text_of,
    vehicle,
)
from pyulog import ULog

from kept_words import lines_with
from rotorfit.errors import OutputError
from rotorfit.export.px4 import newton_per_unit, scaled_mix
from rotorfit.export.vehicle import effectiveness
from rotorfit.export.vehicle_model import vehicle_model
from rotorfit.model.parameters import PARAMETERS, effective_unit

FULL = 1100.0
"""Speed of `LINEAR_LAW` at full command [rad/s]."""
SQUARE = tuple(
    ((x, y, 0.0), spin)
    for x, y, spin in ((0.1, -0.2, "ccw"), (-0.1, 0.2, "ccw"), (0.1, 0.2, "cw"), (-0.1, -0.2, "cw"))
)
FRD = np.array([1.0, -1.0, -1.0])


FEW = 20
"""Draws where the intervals are not looked at."""


def indiflight(text):
    """Return every array of a file by its name."""
    found = re.findall(r"^set indi_act_(\w+) = ([-\d,]+)$", text, flags=re.M)
    return {name: np.array([float(v) for v in values.split(",")]) for name, values in found}


def paparazzi(text):
    defines = ET.fromstring(text).iter("define")
    return {
        d.get("name"): np.array([float(v) for v in d.get("value").strip("{}").split(",")])
        for d in defines
    }


def test_effectiveness_is_newton_euler():
    spin_up = np.array([300.0, -500.0, 700.0, 100.0])
    _, turned = motion(
        body_of(), vehicle(ROTORS), rates=np.zeros(3), speeds=SPEEDS, spin_up=spin_up
    )
    found = effectiveness(vehicle_model(a_result()))
    assert found.turn @ SPEEDS**2 + found.spin_up @ spin_up == pytest.approx(FRD * turned, rel=1e-9)


def test_indiflight_is_in_its_units():
    own = effectiveness(vehicle_model(a_result()))
    found = indiflight(text_of(a_result(), "indiflight", draws=FEW))
    assert found["g1_fz"] == pytest.approx(100 * FULL**2 * own.force[2], abs=0.5)
    assert found["g1_yaw"] == pytest.approx(10 * FULL**2 * own.turn[2], abs=0.5)
    assert found["g2_yaw"] == pytest.approx(1e5 * own.spin_up[2], abs=0.5)
    assert found["max_rpm"] == pytest.approx(np.full(4, FULL * 30 / np.pi), abs=0.5)
    assert found["time_constant_ms"].tolist() == [35] * 4


def test_paparazzi_is_what_one_unit_does_about_hover():
    model = vehicle_model(a_result())
    own, found = effectiveness(model), paparazzi(text_of(a_result(), "paparazzi", draws=FEW))
    step = 1040.0 / 9600.0  # of the law, rad/s a unit
    more = (model.hover_speed + 0.5 * step) ** 2 - (model.hover_speed - 0.5 * step) ** 2
    assert found["G1_ROLL"] == pytest.approx(1e3 * own.turn[0] * more, rel=1e-4)
    assert found["G1_THRUST"] == pytest.approx(1e3 * own.force[2] * more, rel=1e-4)
    assert found["G2"] == pytest.approx(1e3 * 512 * own.spin_up[2] * step, rel=1e-4)


def test_without_rotor_inertia_there_is_no_g2(assert_text):
    lost = changed(a_result(), Jr=not_identified(), Jr_over_Izz=UNKNOWN)
    for target in ("indiflight", "paparazzi"):
        text = text_of(lost, target, draws=FEW)
        assert_text(lines_with(text.replace("G2", "g2"), "g2 is left out"))
        assert "_g2_" not in text and 'name="G2"' not in text


def test_without_a_law_it_is_said_what_is_missing(assert_wording):
    with pytest.raises(OutputError, match=r"max_speed is not in the result .* --assume max_speed"):
        text_of(a_result(law=None), "indiflight", draws=FEW)
    text = text_of(a_result(law=None), "indiflight", draws=FEW, assumed={"max_speed": FULL})
    assert_wording(lines_with(text, "act_nonlinearity is"))
    assert "act_time_constant_ms is left out" in text


def test_what_does_not_fit_into_16_bits_is_refused():
    with pytest.raises(OutputError, match=r"g1_fz would be .* over the 32767"):
        text_of(a_result(law={"linear": [0.0, 12e3]}), "indiflight", draws=FEW)


def test_a_unit_of_thrust_is_all_motors_at_full():
    """PX4's mix of a quadrotor in X is 1 for thrust and yaw, 1/sqrt(2) for roll and pitch."""
    square = flat(rotors=SQUARE, com=np.zeros(3))
    roll, pitch, yaw, thrust = newton_per_unit(vehicle_model(square))
    full = KT * FULL**2
    assert thrust == pytest.approx(4 * full)
    # The larger of both columns of the inverse, that of the shorter arm, scales both.
    assert pitch == pytest.approx(4 * full * 0.1 / np.sqrt(2))
    assert roll == pytest.approx(pitch)
    assert yaw == pytest.approx(4 * KD * FULL**2)


def test_intervals_are_those_of_the_numbers():
    """Nothing but kt is uncertain: thrust is as uncertain as it."""
    exact = {"std": 0.0, "interval": None}
    square = flat(rotors=SQUARE, com=np.zeros(3), inertia_com=np.diag(np.diag(INERTIA_COM)))
    names = {p.name for p in (*square.parameters, *square.derived)} - {"kt"}
    sure = changed(square, **dict.fromkeys(names, exact))
    found = json.loads(text_of(sure, "px4-setpoints"))
    low, high = found["thrust"]["interval"]
    # 1.96 std of 0.5 %; a thousand draws know its ends to a tenth.
    assert 0.5 * (high - low) / found["thrust"]["value"] == pytest.approx(0.0098, rel=0.1)
    hover = found["hover_thrust_setpoint"]
    assert hover["value"] == pytest.approx(MASS * 9.80665 / (4 * KT * FULL**2), rel=1e-3)
    assert hover["interval"][0] < hover["value"] < hover["interval"][1]


def test_of_commands_alone_thrust_is_known_too(assert_wording):
    """kt per squared command is the thrust at full command."""
    per_command = {"kt": 4.0, "kd": 0.05, "Jr": 0.002}
    changes = {
        name: {"value": value, "unit": effective_unit(name, PARAMETERS[name].unit)}
        for name, value in per_command.items()
    }
    left_out = dict.fromkeys([*(f"kt_{i}" for i in range(1, 5)), "Jr_over_Izz", "kd_over_Izz"])
    result = changed(a_result(law=None), **changes, **left_out)
    found = json.loads(text_of(result, "px4-setpoints", draws=FEW))
    assert found["thrust"]["value"] == pytest.approx(16.0)
    assert found["thr_mdl_fac"] == 1.0
    assert_wording(" ".join(found["about"]))


@pytest.mark.flights
def test_the_mix_is_that_of_px4_itself(flight_data_dir):
    """What PX4 asked of its motors in SIH, from its own CA_ROTOR parameters and setpoints."""
    path = flight_data_dir / "autopilot-sitl" / "px4-sih-exported.ulg"
    if not path.is_file():
        pytest.skip(f"no {path}")
    topics = ["actuator_motors", "vehicle_torque_setpoint", "vehicle_thrust_setpoint"]
    log = ULog(str(path), topics)
    own = log.initial_parameters
    position, axis = (
        np.array([[own[f"CA_ROTOR{i}_{what}{a}"] for a in "XYZ"] for i in range(4)])
        for what in "PA"
    )
    ct, km = (np.array([own[f"CA_ROTOR{i}_{what}"] for i in range(4)]) for what in ("CT", "KM"))
    mix = scaled_mix(
        (ct[:, None] * np.hstack([np.cross(position, axis) - km[:, None] * axis, axis])).T
    )
    motors, torque, thrust = (log.get_dataset(name).data for name in topics)
    _, a, b = np.intersect1d(
        motors["timestamp_sample"], torque["timestamp_sample"], return_indices=True
    )
    assert (torque["timestamp_sample"] == thrust["timestamp_sample"]).all()
    setpoint = [torque[f"xyz[{i}]"] for i in range(3)] + [thrust[f"xyz[{i}]"] for i in range(3)]
    asked = np.column_stack([motors[f"control[{i}]"] for i in range(4)])[a]
    free = ((asked > 0.02) & (asked < 0.98)).all(axis=1)
    error = np.abs(np.column_stack(setpoint)[b] @ mix.T - asked)[free]
    assert free.sum() > 20_000
    assert np.quantile(error, 0.99) < 1e-6
