"""What depends on roll and pitch: the scale of the yaw equation and the height of the CoM."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import flown
import made_fit
from rotorfit.estimation.factors import time_block_factors
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.intervals.allowances import coupling_uncertainty, inertia_uncertainty
from rotorfit.fit.intervals.numbers import SCALE_BIAS, Numbers, product_allowance, scale_stretch
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.identification import identify
from rotorfit.model.regressor import regressor
from rotorfit.simulation import (
    STILL,
    TYPICAL,
    Scenario,
    Sensors,
    Sticks,
    layout_vehicle,
    paper_vehicle,
    simulate_flight,
    with_payload,
    write_flight_table,
)

FREE = Sticks()
TURNS_AND_CLIMBS = replace(FREE, roll=STILL.roll, pitch=STILL.pitch)
MORE = {
    "Jr": 2e-5,
    "disturbance_force_std": (0.1,) * 3,
    "disturbance_torque_std": (6e-3, 6e-3, 1.5e-3),
}


def gusty(sticks, *, seed, seconds=25.0, payload=()):
    truth, vehicle = layout_vehicle("quad-x")
    truth = replace(truth, **MORE)
    for item in payload:
        truth = with_payload(truth, **item)
    scenario = Scenario(seconds=seconds, ground_seconds=2.0, sticks=sticks, sensors=TYPICAL)
    return simulate_flight(truth, vehicle, scenario, seed=seed)


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """A flight of turns and climbs alone, with its result."""
    flight = gusty(TURNS_AND_CLIMBS, seed=403)
    return flight, flown.identified(tmp_path_factory.mktemp("turned"), [flight])


def test_without_roll_and_pitch_the_scale_of_yaw_is_not_known(turned):
    _, result = turned
    for name, partner in (("kd", "Izz"), ("Jr", "Izz"), ("Izz", "kd")):
        parameter = result.parameter(name)
        assert (parameter.verdict, parameter.partner) == ("ratio-only", partner)
        assert parameter.value is None
    for name in ("kd_over_kt", "Izz_com", "Izz_over_kt"):
        assert result.derived_value(name).value is None


def test_the_ratios_of_the_yaw_equation_stay(turned):
    flight, result = turned
    truth = flight.truth
    for name, true in (("kd_over_Izz", truth.kd), ("Jr_over_Izz", truth.Jr)):
        low, high = result.derived_value(name).interval
        assert low < true / truth.com_inertia[2, 2] < high
        assert high - low < 0.5 * high  # by the few blocks that tell it


def test_com_height_is_not_identified_without_roll_and_pitch(turned, assert_wording):
    _, result = turned
    assert result.derived_value("com_z").value is None
    height = result.parameter("msz")
    assert height.verdict == "not-identified"
    assert_wording(height.reason)
    assert "wiggle roll and pitch" in height.advice


def test_flying_all_axes_identifies_scale_and_com_height(tmp_path):
    flight = gusty(FREE, seed=400)
    result = flown.identified(tmp_path, [flight])
    truth = flight.truth
    found = {
        "kd": truth.kd,
        "Jr": truth.Jr,
        "Izz_com": truth.com_inertia[2, 2],
        "com_z": truth.center_of_mass[2],
    }
    for name, true in found.items():
        low, high = flown_number(result, name).interval
        assert low < true < high
        assert high - low < 0.5 * abs(true)
    assert result.parameter("kd").verdict == "identified"


def test_a_known_payload_gives_the_scale_without_roll_and_pitch(tmp_path, turned):
    bare, _ = turned
    weights = [{"mass": 0.1, "position": place} for place in ((0.3, 0.0, 0.0), (-0.3, 0.0, 0.0))]
    loaded = gusty(TURNS_AND_CLIMBS, seed=404, payload=weights)
    for name, flight in (("A", bare), ("B", loaded)):
        write_flight_table(flight, tmp_path / f"{name}.csv")
    path = flown.experiment_file(
        tmp_path / "two.toml", bare.vehicle, ["A.csv"], mass=bare.truth.mass
    )
    items = ", ".join(f"{{ mass = 0.1, position = {list(w['position'])} }}" for w in weights)
    more = f'payload_of = "A"\npayload = [{items}]\nflights = ["B.csv"]\n'
    text = path.read_text().replace("[[configuration]]", '[[configuration]]\nname = "A"')
    text += f'[[configuration]]\nname = "B"\nmass = {loaded.truth.mass!r}\n{more}'
    path.write_text(text, encoding="utf-8")
    result = identify(load_experiment(path))
    for name, true in (("kd", bare.truth.kd), ("Jr", bare.truth.Jr)):
        parameter = result.parameter(name)
        assert parameter.verdict == "identified"
        assert parameter.interval[0] < true < parameter.interval[1]
    assert result.derived_value("com_z", "A").value is None


def flown_number(result, name):
    return next(n for n in (*result.parameters, *result.derived) if n.name == name)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
def test_a_stretched_interval_is_as_long_as_that_of_the_inverse(share):
    """1 / scale within +-share: the scale between 1 / (1 + share) and 1 / (1 - share)."""
    length = 1.0 / (1.0 - share) - 1.0 / (1.0 + share)
    assert 2.0 * share * scale_stretch(1.0, share) == pytest.approx(length)
    assert scale_stretch(-2.0, 2.0 * share) == scale_stretch(1.0, share)


def test_an_interval_of_the_scale_that_reaches_zero_has_no_end():
    assert scale_stretch(1.0, 1.0) == scale_stretch(0.0, 0.1) == np.inf


def test_the_scale_of_every_number_is_stretched_alike():
    """k_d known to 50 %: J_r, near zero, is as doubtful as k_d; k_t is not."""
    _, vehicle = layout_vehicle("quad-x")
    model = regressor(vehicle)
    nothing = time_block_factors(np.ones((1, len(model.layout))), block_rows=1)
    body = JointConfiguration(name="A", mass=1.4, factors=nothing, model=model, vehicle=vehicle)
    numbers = Numbers(
        names=("kt", "kd", "Jr", "Izz_com@A", "kd_over_Izz@A"),
        values=np.array([1.0, 1.0, 0.0, 2.0, 0.5]),
        terms=made_fit.known_to(np.array([0.1, 0.5, 0.2, 1.0, 0.05])),
        correlation=np.eye(5),
        excitation={"roll@A": 1e9, "pitch@A": 0.1, "yaw@A": 50.0},
    )
    half = coupling_uncertainty(numbers, [body]).half_width
    expected = [0.1, 0.5 / 0.75, 0.2 / 0.75, 1.0 / 0.75, 0.05]
    np.testing.assert_allclose(half, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("Izz", "half", "factor"), [(2.0, 1.0, 1.0 / 0.75), (0.1, 0.2, 50.0), (6.0, 7.0, 1.0)]
)
def test_products_have_the_scale_of_the_yaw_equation(Izz, half, factor):
    """Known by the inverse, too; unknown, up to the largest I_zz there is: I_xx + I_yy = 5."""
    _, vehicle = layout_vehicle("quad-x")
    model = regressor(vehicle)
    nothing = time_block_factors(np.ones((1, len(model.layout))), block_rows=1)
    body = JointConfiguration(name="A", mass=1.4, factors=nothing, model=model, vehicle=vehicle)
    numbers = Numbers(
        names=("kd", "Ixx_com@A", "Iyy_com@A", "Izz_com@A", "Ixz_com@A", "Ixy_com@A"),
        values=np.array([1.0, 2.0, 3.0, Izz, 0.01, 0.01]),
        terms=made_fit.known_to(np.array([0.1, 0.1, 0.1, half, 0.02, 0.02])),
        correlation=np.eye(6),
        excitation={"roll@A": 1e9, "pitch@A": 1e9, "yaw@A": 50.0},
    )
    found = coupling_uncertainty(numbers, [body]).half_width
    assert found[4:] == pytest.approx([0.02 * factor, 0.02])


@pytest.mark.slow
def test_products_are_as_unsure_as_the_equation_of_yaw(tmp_path):
    """Without turns the autopilot's answer to gusts pulls at kd's scale, and at Ixz with it."""
    vehicle = paper_vehicle("A")
    truth = replace(
        vehicle.truth,
        disturbance_force_std=(0.1,) * 3,
        disturbance_torque_std=(4e-3, 4e-3, 1e-3),
    )
    flight = simulate_flight(
        truth,
        vehicle.vehicle,
        Scenario(
            seconds=40.0,
            ground_seconds=2.0,
            sticks=replace(FREE, yaw=STILL.yaw),
            sensors=Sensors(gyro_std=0.02, accel_std=0.4, rotor_speed_std=3.0),
        ),
        seed=26,
    )
    result = flown.identified(tmp_path, [flight])
    for name, true in (("Ixz_com", truth.com_inertia[0, 2]), ("Iyz_com", truth.com_inertia[1, 2])):
        low, high = result.derived_value(name).interval
        assert low < true < high
    assert result.parameter("rotor_drag").verdict == "not-identified"


@given(rho=st.floats(0.0, 1e4), size=st.floats(-1.0, 1.0))
def test_what_yaw_leaves_open_of_a_product_is_a_share_of_it(rho, size):
    allowed = product_allowance(size, rho)
    assert abs(size) * SCALE_BIAS / (rho + SCALE_BIAS) == pytest.approx(allowed)
    assert allowed <= abs(size)


@pytest.mark.parametrize("rho", [2.5, 6.0])
def test_gust_bias_of_pitch_inertia_widens_correlated_yaw_scale(rho):
    body = made_fit.configuration()
    names = ("kt", "kd", "Ixx_com@A", "Iyy_com@A", "Izz_com@A", "kd_over_Izz@A")
    correlation = np.eye(6)
    for other in (0, 1, 4, 5):
        correlation[3, other] = correlation[other, 3] = 0.8
    numbers = Numbers(
        names=names,
        values=np.array([1.0, 1.0, 1.5, 2.0, 3.0, 0.3]),
        terms=made_fit.known_to(np.array([0.1, 0.3, 0.2, 0.2, 1.2, 0.01])),
        correlation=correlation,
        excitation={"roll@A": 50.0, "pitch@A": rho, "yaw@A": 50.0},
    )
    std = np.array([0.05, 0.05, 0.1, 0.1, 0.2, 0.005])
    found = inertia_uncertainty(numbers, [body], std).half_width
    # Half of I_yy at a rho of 2.5, times .4 and 1.6.
    expected = [0.1, 0.5, 0.2, 0.2, 2.0, 0.01] if rho < 5.0 else numbers.half_width
    np.testing.assert_allclose(found, expected)
