"""A Betaflight log on commands alone, weakly flown: what it tells, and no more."""

import pytest

import flown
from rotorfit.model.vehicle import Rotor, Vehicle

pytestmark = pytest.mark.flights

ARM = 0.12
PROPS_OUT = Vehicle(
    rotors=(
        Rotor(position=(-ARM, -ARM, 0.0), spin="ccw"),
        Rotor(position=(ARM, -ARM, 0.0), spin="cw"),
        Rotor(position=(-ARM, ARM, 0.0), spin="cw"),
        Rotor(position=(ARM, ARM, 0.0), spin="ccw"),
    )
)


@pytest.fixture(scope="module")
def result(on_commands):
    return on_commands("betaflight/LOG00037.BFL", PROPS_OUT, mass="unknown")


def test_thrust_per_mass_is_what_carries_the_weight(result):
    """A quarter of the weight at the rms command, whatever the law: 19.6 N/kg a squared command."""
    hover = result.derived_value("hover_throttle")
    assert hover.value == pytest.approx((9.81 / 4 / 19.6) ** 0.5, rel=0.04)
    assert hover.interval[1] - hover.interval[0] < 0.1 * hover.value
    # Its law is between thrust with the command and with its square, as of every motor.
    (seen,) = (e for f in result.findings for e in f.evidence if e.name == "law_exponent_flown")
    assert 0.5 < seen.interval[0] < seen.interval[1] < 1.0


def test_thrust_at_full_command_is_as_open_as_the_law(result):
    kt, ratio = result.parameter("kt"), result.derived_value("thrust_to_weight")
    assert kt.interval[1] - kt.interval[0] > 0.4 * kt.value
    assert ratio.interval[0] < 4 * kt.value / 9.81 < ratio.interval[1]


def test_lag_and_delay_are_those_of_the_likeliest_fit(result):
    """Once it was 0, 34 or 150 ms, whichever end of the flight one sample was taken from.

    The filters that the log names are no longer in it, of gyro and accelerometer: with them the lag
    was 34.5 ms, and with the accelerometer's 28.6.
    """
    assert result.parameter("motor_lag").value == pytest.approx(0.0267, abs=0.0005)
    assert result.parameter("motor_delay").value == pytest.approx(0.0031, abs=0.0003)
    # A delay and a lag look alike to slow commands: their sum is known better than the lag.
    total = result.derived_value("motor_lag_total")
    assert total.verdict == "identified"
    assert total.std < result.parameter("motor_lag").std


def test_no_turn_of_so_calm_a_flight_gives_inertia(result, assert_wording):
    assert_wording(result.derived_value("Jr_over_Izz").reason)
    for name in ("kd", "Ixx", "Iyy", "Izz"):
        assert result.parameter(name).value is None


def test_a_window_whose_fit_went_round_its_bottom_settles(flight_data_dir, tmp_path):
    """Its steps ended at 0.03 to 0.05 of a deviation, up and down, and it was refused."""
    log = flight_data_dir / "betaflight" / "LOG00037.BFL"
    if not log.is_file():
        pytest.skip(f"no {log}")
    path = tmp_path / "experiment.toml"
    commands = '[motors]\nspeed = "commanded"\n'
    flown.experiment_file(path, PROPS_OUT, [log], mass="unknown", extra=commands)
    whole = f'flights = ["{log}"]'
    window = f'flights = [{{ file = "{log}", start = 0.0, end = 6.70361 }}]'
    path.write_text(path.read_text().replace(whole, window))
    assert window in path.read_text()
    hover = flown.quietly_identified(path).derived_value("hover_throttle")
    assert hover.value == pytest.approx(0.345, rel=0.1)  # of the whole flight; the battery is fresh
