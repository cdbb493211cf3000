"""The exported model under the stock autopilot: hover holds, steps settle, a wrong one shows."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from export_material import KD, LAG, a_result, changed

from rotorfit.errors import OutputError
from rotorfit.export.mujoco import STOCK_LAG, STOCK_THRUST, fly_manoeuvre, flyable
from rotorfit.export.targets import BODY, ROTORS
from rotorfit.export.vehicle_model import vehicle_model
from rotorfit.results.validation.fly_outcome import (
    MANOEUVRES,
    STEP,
    STEPS,
    ModelFlight,
    departure,
    is_lost,
    overshoot,
    settling_time,
)


def model_of(result, **options):
    model = vehicle_model(result, needs=(*BODY, *ROTORS), speed="full-command", **options)
    return flyable(model)[0]


@pytest.fixture(scope="module")
def mujoco():
    return pytest.importorskip("mujoco", reason="mujoco is not installed")


@pytest.fixture(scope="module")
def model():
    return model_of(a_result())


def test_hover_holds_its_height(mujoco, model):
    flight = fly_manoeuvre(model, "hover")
    assert flight.time[-1] == pytest.approx(8.0, abs=0.01)
    assert not is_lost(flight)
    assert departure(flight) < 0.02
    assert flight.tilt.max() < 0.03


@pytest.mark.parametrize("name", STEPS)
def test_a_step_settles(mujoco, model, name):
    flight = fly_manoeuvre(model, name)
    assert flight.asked[-1] == STEP[name]
    assert not is_lost(flight)
    assert settling_time(flight) < 0.65
    assert overshoot(flight) < 0.15


@pytest.mark.parametrize("factor", [1 / 3, 1 / 4])
def test_an_autopilot_tuned_to_wrong_inertia_flies_visibly_worse(mujoco, model, factor):
    wrong = replace(model, inertia_com=factor * model.inertia_com)
    for name in STEPS:
        right = fly_manoeuvre(model, name)
        worse = fly_manoeuvre(model, name, believed=wrong)
        late = settling_time(worse)
        assert late is None or late > 1.5 * settling_time(right)


def test_a_wrong_mass_shows_in_the_height(mujoco, model):
    heavy = replace(model, mass=1.1 * model.mass)
    assert departure(fly_manoeuvre(model, "hover", believed=heavy)) > 0.5


def test_motors_in_the_wrong_order_are_lost(mujoco, model):
    one, two, three, four = model.rotors
    crossed = replace(model, rotors=(three, four, one, two))
    assert is_lost(fly_manoeuvre(model, "roll", believed=crossed))


def test_unequal_rotors_and_a_com_off_centre_are_trimmed(mujoco, model):
    flight = fly_manoeuvre(model, "roll")
    before = flight.flown[flight.time < 0.25]
    assert np.abs(before).max() < 0.01


def test_what_is_not_known_of_the_motors_is_said():
    measured = a_result(law=None)
    bare = vehicle_model(measured, needs=(*BODY, *ROTORS), speed="full-command")
    model, taken = flyable(bare)
    assert (model.lag_up, model.lag_down) == (STOCK_LAG, STOCK_LAG)
    assert model.max_speed == pytest.approx(STOCK_THRUST**0.5 * model.hover_speed)
    assert len(taken) == 2
    assert "--assume motor_lag=VALUE" in taken[0]
    known, none = flyable(vehicle_model(a_result(), needs=(*BODY, *ROTORS)))
    assert none == ()
    assert known.lag_up == LAG


def test_yaw_that_is_only_a_ratio_flies_with_an_assumption(mujoco):
    lost = {"value": None, "std": None, "interval": None, "verdict": "ratio-only"}
    result = changed(
        a_result(),
        kd={**lost, "partner": "Izz"},
        Izz={**lost, "partner": "kd"},
        Izz_com={"value": None, "std": None, "interval": None},
    )
    with pytest.raises(OutputError, match="--assume kd=VALUE"):
        model_of(result)
    assert settling_time(fly_manoeuvre(model_of(result, assumed={"kd": KD}), "yaw rate")) < 0.65


def test_mujoco_missing_is_one_line(monkeypatch, model):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(OutputError, match=r'pip install "rotorfit\[mujoco\]"'):
        fly_manoeuvre(model, "hover")


def of(flown, *, tilt=0.1):
    time = np.arange(len(flown)) * 0.5
    return ModelFlight(
        manoeuvre="roll",
        time=time,
        asked=np.full(len(flown), 0.25),
        flown=np.array(flown),
        tilt=np.full(len(flown), tilt),
    )


def test_numbers_of_a_step_by_hand():
    assert MANOEUVRES[0] == "hover"
    step = of([0.0, 0.2, 0.3, 0.26, 0.25])
    assert overshoot(step) == pytest.approx(0.2)
    assert settling_time(step) == pytest.approx(1.5 - 0.25)
    assert settling_time(of([0.0, 0.25, 0.3])) is None
    assert departure(step) == pytest.approx(0.25)
    assert is_lost(of([0.25, 0.25], tilt=1.5))
    assert is_lost(of([0.25, np.nan]))
    assert not is_lost(step)


def test_a_broken_installation_keeps_its_own_advice(monkeypatch):
    """MuJoCo 3.17 upgraded in place to 4.0.0: its ImportError names the repair."""
    from rotorfit.errors import OutputError
    from rotorfit.export import mujoco as flown

    def broken(name):
        raise ImportError("pip install --force-reinstall mujoco-core")

    monkeypatch.setattr(flown, "import_module", broken)
    with pytest.raises(OutputError) as refused:
        flown.require_mujoco()
    assert "--force-reinstall mujoco-core" in str(refused.value)
    assert "rotorfit[mujoco]" not in str(refused.value)
