"""What the air does at speed, in the files of simulators that have a place for it."""

import runpy
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from export_material import (
    KT,
    MASS,
    RATES,
    ROTORS,
    SPEEDS,
    a_result,
    changed,
    flat,
    saved,
    text_of,
    vehicle,
)

from newton_euler import flight_of
from rotorfit.model.parameters import PARAMETERS
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_matrix
from rotorfit.model.terms.registry import added_signals
from rotorfit.model.vehicle import Vehicle
from rotorfit.results.result import Parameter

CENTERED = tuple(
    (tuple(np.array(p) - np.mean([q for q, _ in ROTORS], axis=0)), s) for p, s in ROTORS
)
DRAG = 4.2e-5
VELOCITY = np.array([7.0, -4.0, 2.0])
SHARED = ("rotor_drag", "inflow")


def with_air(result, *, unit="{}", **values):
    """Return a result to which flights have told what the air does, each within a tenth."""
    told = tuple(
        Parameter(
            name=name,
            configuration=None if name in SHARED else "A",
            value=value,
            std=0.05 * value,
            interval=(0.9 * value, 1.1 * value),
            unit=unit.format(PARAMETERS[name].unit),
            verdict="identified",
        )
        for name, value in values.items()
    )
    kept = [p for p in result.parameters if p.name not in values]
    return replace(result, parameters=(*kept, *told))


def dragged(positions):
    """Return the wrench of the rotors' drag about the CoM by the model of the identification."""
    added = added_signals(["drag", "rotor_drag"])
    own = vehicle()
    placed = zip(own.rotors, positions, strict=True)
    own = Vehicle(rotors=tuple(replace(r, position=tuple(map(float, p))) for r, p in placed))
    rows = [np.zeros((1, 3)), RATES[None], np.zeros((1, 3)), SPEEDS[None], np.zeros((1, 4))]
    flight = flight_of(*rows, velocity=VELOCITY[None])
    A = regressor(own, added=added)
    return -A.residual(signal_matrix(flight, own, 0, 1, added=added), {"rotor_drag": DRAG})[0]


def test_rotorpy_drags_each_rotor_as_the_model_does(tmp_path):
    """multirotor.py: H = -w diag(k_d, k_d, k_z) (v + rates x r) at each rotor from the CoM."""
    result = with_air(flat(), rotor_drag=DRAG, inflow=1e-4)
    file = saved(tmp_path, result, "rotorpy", "params.py")
    p = runpy.run_path(str(file))["quad_params"]
    places = np.array([p["rotor_pos"][f"r{i}"] for i in range(1, 5)])
    local = VELOCITY + np.cross(RATES, places)
    H = -SPEEDS[:, None] * local * [p["k_d"], p["k_d"], p["k_z"]]
    found = np.concatenate([H.sum(axis=0), np.cross(places, H).sum(axis=0)])
    np.testing.assert_allclose(found, dragged(places), rtol=1e-9, atol=1e-12)
    text = file.read_text()
    assert "no place for: inflow" in text and "no place for: rotor_drag" not in text


@pytest.mark.parametrize("target", ["gazebo", "gazebo-motors"])
def test_gazebo_drags_each_rotor_as_the_model_does(target):
    """MulticopterMotorModel.cc: -|w| rotorDragCoefficient times the link's velocity across z."""
    text = text_of(with_air(a_result(), rotor_drag=DRAG), target)
    found = text if target == "gazebo" else f"<model>{text}</model>"
    plugins = [
        e for e in ET.fromstring(found).iter("plugin") if e.find("motorConstant") is not None
    ]
    assert len(plugins) == 4
    drag = np.array([float(e.findtext("rotorDragCoefficient", "")) for e in plugins])
    places = np.array([p for p, _ in ROTORS])
    across = (VELOCITY + np.cross(RATES, places)) * [1.0, 1.0, 0.0]
    force = -np.abs(SPEEDS)[:, None] * drag[:, None] * across
    expected = dragged(places)
    np.testing.assert_allclose(force.sum(axis=0), expected[:3], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.cross(places, force).sum(axis=0), expected[3:], atol=1e-12)
    # A torque against the velocity, not the wakes', which lifts the front.
    assert {e.findtext("rollingMomentCoefficient") for e in plugins} == {"0"}


@pytest.mark.parametrize("target", ["gazebo", "rotorpy"])
def test_drag_that_may_be_none_is_left_out(target):
    result = with_air(a_result() if target == "gazebo" else flat(), rotor_drag=DRAG)
    wide = changed(result, rotor_drag={"interval": (-0.1 * DRAG, 2.1 * DRAG)})
    text = text_of(wide, target)
    name = {"gazebo": "<rotorDragCoefficient>0<", "rotorpy": "'k_d': 0"}[target]
    assert name in text and "no place for: rotor_drag" in text


def test_drag_per_command_is_that_of_the_nominal_speed():
    """N s/m per command over 1000 rad/s at full command, as thrust over its square."""
    each = {f"kt_{i}": None for i in range(1, 5)}
    kt = {"unit": "N per squared command", "value": 4.2, "interval": (4.1, 4.3)}
    kd = {"unit": "N m per squared command", "value": 0.063, "interval": (0.06, 0.066)}
    result = changed(a_result(law=None), kt=kt, kd=kd, Jr=None, **each)
    result = replace(result, settings={**result.settings, "motors": {"speed": "commanded"}})
    result = with_air(result, unit="N s/m per command", rotor_drag=0.05)
    text = text_of(result, "gazebo", assumed={"motor_lag": 0.03})
    assert "<rotorDragCoefficient>5e-05<" in text


def params(text):
    rows = [line.split("\t") for line in text.splitlines() if not line.startswith("#")]
    return {row[2]: float(row[3]) for row in rows}


def test_sih_brakes_as_the_vehicle():
    """sih.cpp: force -KDV v, torque -KDW w; the rotors' part as they turn in hover.

    In a slow climb the induced velocity falls by half of it, and half of the inflow is left.
    """
    result = flat(rotors=CENTERED, com=np.zeros(3), imu=np.zeros(3))
    assert params(text_of(result, "px4-sih"))["SIH_KDW"] == 0.0
    squares = sum(x * x + y * y for (x, y, _), _ in CENTERED)
    hover = np.sqrt(MASS * 9.80665 / (4 * KT))
    frame = {"drag_x": 0.9, "drag_y": 1.1, "drag_z": 1.0}
    turns = {"turn_damping_x": 0.02, "turn_damping_y": 0.03}
    rotors = {"rotor_drag": 0.025 / (hover * squares), "inflow": 0.3 / (4 * hover)}
    text = text_of(with_air(result, **frame, **turns, **rotors), "px4-sih")
    p = params(text)
    each = 4 * 0.025 / squares
    assert p["SIH_KDV"] == pytest.approx((0.9 + each + 1.1 + each + 1.0 + 0.15) / 3)
    assert p["SIH_KDW"] == pytest.approx(0.025)
    assert "has no place for" not in text
    assert "drag_x = 0.9" in text_of(with_air(result, **frame), "px4")
