"""Flights of which only the commands are known: with and without the motors' law."""

import numpy as np
import pytest

from flown import experiment_file, quietly_identified, simulated
from rotorfit.errors import ExperimentError, FlightError, LogError
from rotorfit.logs.table import write_table
from rotorfit.model.parameters import DERIVED, EFFECTIVE_UNITS, PARAMETERS, effective_unit
from rotorfit.results.command_units import NO_LAW
from rotorfit.results.result import is_per_command
from rotorfit.simulation import to_flight_log

JUDGED = ("kt", "kd", "Jr", "msx", "msy", "Ixx_com", "Iyy_com", "Izz_com")
OFFSET = 40.0


@pytest.fixture(scope="module")
def flight():
    return simulated("quad-x", "noisy", seed=4, seconds=25.0)


def identified(folder, flight, *, motors, mass=None, recorded=None, battery=None, column="command"):
    """Identify from gyro, accelerometer and commands, recorded as a function of theirs."""
    log = to_flight_log(flight, channels=("gyro", "accel", "command"))
    columns = {"time": flight.time}
    for name in ("gyro", "accel"):
        for k, axis in enumerate("xyz"):
            columns[f"{name}_{axis}"] = log.channels[name].values[:, k]
    command = log.channels["command"].values
    command = command if recorded is None else recorded(command)
    for k in range(command.shape[1]):
        columns[f"{column}_{k + 1}"] = command[:, k]
    if battery is not None:
        columns["battery"] = battery
    write_table(folder / "flight.csv", columns, force=True)
    lag = f"lag = {flight.truth.motor_lag}"
    path = experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [(folder / "flight.csv").relative_to(folder)],
        mass=flight.truth.mass if mass is None else mass,
        extra=f'[motors]\nspeed = "commanded"\n{lag}\n{motors}',
    )
    return quietly_identified(path)


def numbers(result):
    return {number.name: number for number in (*result.parameters, *result.derived)}


def root_command(speed):
    """Command that PX4's thrust model with THR_MDL_FAC = 0.3 turns into a relative speed."""
    return (np.sqrt(0.7**2 + 4 * 0.3 * speed**2) - 0.7) / (2 * 0.3)


# Name: the law's text for a largest speed w, and the command for a relative speed.
LAWS = {
    "linear": (
        lambda w: f"linear = [{-OFFSET}, {w + OFFSET}]",
        lambda w, speed: (speed * w + OFFSET) / (w + OFFSET),
    ),
    "polynomial": (lambda w: f"polynomial = [0, 0, {w}]", lambda w, speed: np.sqrt(speed)),
    "table": (
        lambda w: f"table = [[0, 0], [0.4, {0.5 * w}], [1, {w}]]",
        lambda w, speed: np.interp(speed, [0, 0.5, 1], [0, 0.4, 1]),
    ),
    "sqrt": (
        lambda w: f"sqrt = {{ full_speed = {w}, thr_mdl_fac = 0.3 }}",
        lambda w, speed: root_command(speed),
    ),
}


@pytest.mark.parametrize("law", LAWS)
def test_a_flight_with_its_law_lands_inside_its_intervals(tmp_path, flight, law):
    text, command = LAWS[law]
    w = float(flight.max_speed)
    result = identified(
        tmp_path,
        flight,
        motors=f"law = {{ {text(w)} }}",
        recorded=lambda speed: command(w, speed),
    )
    found, truth = numbers(result), flight.truth.parameters()
    for name in JUDGED:
        low, high = found[name].interval
        assert low <= truth[name] <= high, name
    assert found["kt"].unit == PARAMETERS["kt"].unit
    assert NO_LAW not in result.warnings
    assert not any("carrying the weight takes" in doubt for doubt in result.warnings)


def test_the_battery_is_part_of_the_law(tmp_path, flight, assert_wording):
    w = float(flight.max_speed)
    volts = np.linspace(12.6, 10.5, len(flight.time))
    motors = f"law = {{ linear = [0, {w}], voltage = {{ nominal = 12.0 }} }}"
    sagged = {"recorded": lambda speed: speed * (12.0 / volts)[:, None]}
    found = numbers(identified(tmp_path, flight, motors=motors, battery=volts, **sagged))
    low, high = found["kt"].interval
    assert low <= flight.truth.kt <= high
    blind = f"law = {{ linear = [0, {w}] }}"
    other = identified(tmp_path, flight, motors=blind, **sagged)
    assert_wording(other.warnings)
    assert numbers(other)["kt"].std > 3.0 * (high - low) / 3.92
    with pytest.raises(LogError, match=r"flight.csv: .* the log has no battery voltage"):
        identified(tmp_path, flight, motors=motors, **sagged)


def speeds(flight):
    w = float(flight.max_speed)
    return {"recorded": lambda command: w * command, "column": "rotor"}


def test_commanded_speeds_are_taken_as_they_are(tmp_path, flight):
    """Simulators command rad/s: no law is needed, and every unit is per rad/s."""
    result = identified(tmp_path, flight, motors="", **speeds(flight))
    found, truth = numbers(result), flight.truth.parameters()
    for name in JUDGED:
        low, high = found[name].interval
        assert low <= truth[name] <= high, name
    assert found["kt"].unit == PARAMETERS["kt"].unit
    assert NO_LAW not in result.warnings
    assert not is_per_command(result.parameters)
    kt = identified(tmp_path, flight, motors="").parameter("kt")
    w = float(flight.max_speed)
    # Without a law the thrust at full command hangs on the one that the flight shows.
    assert kt.interval[0] < found["kt"].value * w**2 < kt.interval[1]
    assert kt.std / kt.value > 3.0 * found["kt"].std / found["kt"].value


def test_commanded_speeds_need_no_law(tmp_path, flight):
    law = f"law = {{ linear = [0, {float(flight.max_speed)}] }}"
    with pytest.raises(ExperimentError, match=r"commands rotor speeds .*: leave law out"):
        identified(tmp_path, flight, motors=law, **speeds(flight))


def test_rpm_among_commanded_speeds_is_refused(tmp_path, flight):
    rpm = {"recorded": lambda c: 9.549 * float(flight.max_speed) * c, "column": "rotor"}
    with pytest.raises(FlightError, match="rpm"):
        identified(tmp_path, flight, motors="", **rpm)


@pytest.mark.parametrize("mass", [None, "unknown"])
def test_without_a_law_units_are_per_command_but_not_of_products(tmp_path, flight, mass):
    result = identified(tmp_path, flight, motors="", mass=mass)
    found, truth, w = numbers(result), flight.truth.parameters(), float(flight.max_speed)
    assert NO_LAW not in result.warnings
    [found_law] = [f for f in result.findings if f.kind == "law-found"]
    low, high = found_law.evidence[0].interval
    assert low < 1.0 < high
    per = " per kg" if mass else ""
    assert found["kt"].unit == f"N per squared command{per}"
    assert found["kd"].unit == f"N m per squared command{per}"
    assert found["hover_speed"].unit == "command"
    assert found["Ixx_com"].unit == f"kg m^2{per}"
    assert found["kd_over_kt"].unit == "m"
    scale = truth["mass"] if mass else 1.0
    for name, factor in {"kt": w**2, "kd": w**2, "Ixx_com": 1.0, "Iyy_com": 1.0}.items():
        low, high = found[name].interval
        assert low <= truth[name] * factor / scale <= high, name
    low, high = found["kd_over_kt"].interval
    assert low <= truth["kd"] / truth["kt"] <= high


@pytest.mark.parametrize("power", [1.0, 1.5])
def test_the_flight_shows_how_thrust_grows_with_the_command(tmp_path, flight, power):
    """Commands whose thrust goes with that power of them: inertia and full thrust are found."""
    result = identified(tmp_path, flight, motors="", recorded=lambda u: u ** (2.0 / power))
    [law] = [f for f in result.findings if f.kind == "law-found"]
    exponent, flown = law.evidence
    # Changes of thrust count once: with them the law was found, and k_t is the weight's.
    [agreed] = [f for f in result.findings if f.kind == "thrust-against-weight"]
    assert [e.name for e in agreed.evidence] == ["kt_of_weight"]
    assert 2.0 * exponent.interval[0] < power < 2.0 * exponent.interval[1]
    assert 2.0 * flown.value == pytest.approx(power, rel=0.01)
    # One step from the squared command ends 2 % too high where thrust goes with the command.
    assert 2.0 * exponent.value == pytest.approx(power, rel=0.01)
    found, truth = numbers(result), flight.truth.parameters()
    full = truth["kt"] * float(flight.max_speed) ** 2
    wanted = {**{name: truth[name] for name in ("Ixx_com", "Iyy_com")}, "max_thrust": full}
    for name, true in wanted.items():
        low, high = found[name].interval
        assert low < true < high, name
        assert high - low < 0.5 * true, name
        assert found[name].verdict == "identified"


def test_the_command_in_hover_does_not_hang_on_the_law(tmp_path, flight):
    result = identified(tmp_path, flight, motors="", recorded=lambda u: u**2)
    found = numbers(result)["hover_throttle"]
    full = 4.0 * flight.truth.kt * float(flight.max_speed) ** 2
    assert found.interval[0] < flight.truth.mass * 9.80665 / full < found.interval[1]
    assert found.std < 0.02 * found.value
    thrust = numbers(result)["thrust_to_weight"]
    assert thrust.std > 0.02 * thrust.value


@pytest.mark.parametrize(("offset", "power"), [(-0.3, 2.0), (0.2, 2.0), (0.0, 1.5)])
def test_a_wrong_law_is_put_right_by_the_flight(tmp_path, flight, offset, power, assert_wording):
    """Speeds in proportion to the command, or thrust with its power, by a law that is no such."""
    w = float(flight.max_speed)
    wrong = f"law = {{ linear = [{offset * w}, {(1.0 - offset) * w}] }}"
    result = identified(tmp_path, flight, motors=wrong, recorded=lambda u: u ** (2.0 / power))
    [said] = [one for one in result.findings if one.kind == "law-contradicted"]
    assert said.severity == "doubt"
    assert_wording(said.sentence)
    found, truth = numbers(result), flight.truth.parameters()
    for name in ("Ixx_com", "Iyy_com"):
        low, high = found[name].interval
        assert low < truth[name] < high, name
        assert high - low < 0.25 * truth[name], name
        assert found[name].verdict == "identified"
    assert found["kt"].verdict == found["kt_1"].verdict == "doubtful"


def test_the_units_are_those_of_the_equations(assert_text):
    """With speeds in commands, every rad/s of a parameter's unit becomes a command."""
    assert set(EFFECTIVE_UNITS) <= {*PARAMETERS, *DERIVED}
    assert effective_unit("kt_3", PARAMETERS["kt"].unit) == EFFECTIVE_UNITS["kt"]
    assert_text(effective_unit("kd", "N m s^2/rad^2 per kg"))
    assert effective_unit("Ixx", "kg m^2 per kg") == "kg m^2 per kg"
    # N m of torque per command per second; and 1/s^2 of yaw acceleration per squared command.
    assert effective_unit("Jr", "kg m^2") == "N m s per command"
    assert effective_unit("kd_over_Izz", "1/rad^2") == "1/s^2 per squared command"
    assert effective_unit("Jr_over_Izz", "1") == "1/s per command"
    for name, info in {**PARAMETERS, **DERIVED}.items():
        assert "rad" not in effective_unit(name, info.unit), name
