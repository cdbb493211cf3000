"""IMU against motion capture (P15): one flight, both sources; delay found; real recordings."""

import dataclasses

import pytest

from flown import experiment_file, quietly_identified
from rotorfit.errors import LogError
from rotorfit.results.compare import compare_results
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant
from rotorfit.simulation import write_flight_table as write_table
from rotorfit.simulation.experiment_files import simulate

POSE = ("position", "attitude")
IMU_AND_POSE = ("gyro", "accel", "rotor_speed", *POSE)
DELAY = 0.012


def flown(kind, folder, *, vehicle="A", channels=IMU_AND_POSE, **sensors):
    """A flight with both sources in one table; motion capture is late by DELAY."""
    simulated, errors = variant(paper_vehicle(vehicle), kind)
    if kind != "clean":
        errors = dataclasses.replace(errors, position_std=3e-4, attitude_std=2e-3, pose_rate=100.0)
    errors = dataclasses.replace(errors, pose_delay=DELAY, **sensors)
    flight = simulate_flight(*simulated, Scenario(seconds=60.0, sensors=errors), seed=5)
    write_table(flight, folder / "flight.csv", channels=channels)
    return flight


def identified(folder, flight, options, *, extra=""):
    path = experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [folder / "flight.csv"],
        mass=flight.truth.mass,
        extra=f"{extra}\n[identification]\n{options}",
    )
    return quietly_identified(path)


def errors_of(result, truth):
    """Relative error of each parameter that has a value."""
    names = (*("msx", "msy", "msz"), *("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"))
    true = dict(zip(names, (*truth.first_moments, *truth.inertia), strict=True))
    true |= {"kt": truth.kt, "kd": truth.kd}
    found = {name: result.parameter(name).value for name in true}
    return {name: v / true[name] - 1 for name, v in found.items() if v is not None}


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Return a folder and the flight without noise that is in it."""
    folder = tmp_path_factory.mktemp("clean")
    return folder, flown("clean", folder)


def test_without_noise_total_least_squares_is_exact(clean, assert_wording):
    folder, flight = clean
    result = identified(folder, flight, 'method = "tls"\nsource = "mocap"')
    errors = errors_of(result, flight.truth)
    assert abs(errors["kt"]) < 1e-4
    assert max(abs(errors[name]) for name in ("Ixx", "Iyy", "Izz", "kd")) < 1e-3
    delay = result.parameter("motor_delay")
    assert delay.value == pytest.approx(DELAY, abs=3e-4)
    assert_wording(result.warnings)


def test_without_noise_row_by_row(clean):
    folder, flight = clean
    result = identified(folder, flight, 'method = "ols"\nsource = "mocap"')
    errors = errors_of(result, flight.truth)
    assert abs(errors["kt"]) < 1e-4
    assert max(abs(errors["Ixx"]), abs(errors["Iyy"])) < 1e-3


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("noisy")
    flight = flown("noisy", folder, vehicle="B")
    results = [identified(folder, flight, f'source = "{s}"') for s in ("imu", "mocap")]
    return flight, results


def test_both_sources_give_the_same_parameters(noisy):
    flight, results = noisy
    numbers = {n.name: n for n in compare_results(results, ("imu", "mocap")).numbers}
    for name in ("kt", "kd", "msx", "msy", "Ixx", "Iyy", "Izz"):
        assert abs(numbers[name].entries[1].difference) < 0.02, name
        assert numbers[name].entries[1].overlap, name
    assert abs(errors_of(results[1], flight.truth)["msz"]) < 0.08
    for name, error in errors_of(results[1], flight.truth).items():
        if name in ("kt", "kd", "msx", "msy", "Ixx", "Iyy", "Izz"):
            assert abs(error) < 0.02, name


@pytest.mark.slow
def test_commands_seen_by_cameras_have_their_lag_found(tmp_path):
    """Lag taken for delay makes thrust follow commands too early, and kt 4 % too small."""
    simulate(tmp_path, "single", "noisy", seconds=20.0, seed=2)
    experiment = tmp_path / "experiment.toml"
    table = "[identification]\n"
    experiment.write_text(experiment.read_text().replace(table, f'{table}source = "mocap"\n'))
    result = quietly_identified(experiment)
    kt, lag = result.parameter("kt"), result.parameter("motor_lag")
    assert kt.value == pytest.approx(4e-6, rel=5e-3)
    assert kt.interval[0] < 4e-6 < kt.interval[1]
    assert lag.value == pytest.approx(0.04, abs=2e-3)
    doubts = [found.kind for found in result.findings if found.severity == "doubt"]
    assert "thrust-against-weight" not in doubts


def test_the_delay_of_motion_capture_is_found(noisy):
    _, (imu, mocap) = noisy
    assert mocap.parameter("motor_delay").value == pytest.approx(DELAY, abs=1e-3)
    low, high = mocap.parameter("motor_delay").interval
    assert low < DELAY < high
    assert abs(imu.parameter("motor_delay").value) < 1e-3
    assert mocap.flights[0].warnings == ()


def test_commands_and_motion_capture_alone(tmp_path):
    """No IMU, no measured speed: law and lag are known, the delay holds half a command period."""
    flight = flown("noisy", tmp_path, channels=("command", *POSE))
    motors = f"law = {{ polynomial = [0.0, {flight.max_speed}] }}\nlag = 0.04"
    extra = f'[motors]\nspeed = "commanded"\n{motors}'
    result = identified(tmp_path, flight, 'source = "mocap"', extra=extra)
    assert result.parameter("motor_delay").value == pytest.approx(DELAY + 0.0025, abs=1e-3)
    errors = errors_of(result, flight.truth)
    assert max(abs(errors[name]) for name in ("kt", "Ixx", "Iyy")) < 0.02


@pytest.mark.flights
def test_a_recording_without_motors_is_refused(flight_data_dir, tmp_path):
    recording = flight_data_dir / "optitrack-airgarage" / "20240824_00_08_07.csv"
    columns = ", ".join(
        f'{name} = "{column}"'
        for name, column in {
            "time": "t",
            **{f"pos_{a}": a for a in "xyz"},
            **{f"quat_{a}": f"q{a}" for a in "wxyz"},
        }.items()
    )
    with pytest.raises(LogError, match="no motor data"):
        real(tmp_path, recording, columns)


NANOBENCH = {
    "time": '"t"',
    **{f"pos_{a}": f'"p{a}"' for a in "xyz"},
    **{f"quat_{a}": f'"q{a}"' for a in "wxyz"},
    **{
        f"command_{i}": f'{{ name = "motor_motor_m{i}", scale = {1 / 65536} }}' for i in range(1, 5)
    },
}


@pytest.mark.flights
@pytest.mark.slow
def test_vicon_and_commands_of_a_small_quadrotor(flight_data_dir, tmp_path):
    """Commands at 25 Hz, thrust not in proportion to their square: little is known, and said."""
    recording = flight_data_dir / "nanobench-crazyflie" / "B8_star_fast_rep1.csv"
    columns = ", ".join(f"{name} = {column}" for name, column in NANOBENCH.items())
    result = real(tmp_path, recording, columns)
    (used,) = result.flights
    assert 25 < used.seconds_used < 42
    doubts = [found.kind for found in result.findings if found.severity == "doubt"]
    assert "thrust-against-weight" in doubts
    assert result.parameter("kt").value * 3.0 == pytest.approx(0.027 * 9.9, rel=0.05)
    for name in ("Ixx", "Iyy", "Izz", "kd"):
        assert result.parameter(name).verdict == "not-identified"
    for name in ("motor_lag", "motor_delay"):
        assert result.parameter(name).verdict == "not-identified"


def real(folder, recording, columns):
    path = folder / "experiment.toml"
    path.write_text(
        '[airframe]\nlayout = "quad-x"\narm = 0.046\norder = "crazyflie"\n'
        '[motors]\nspeed = "commanded"\n[identification]\nsource = "mocap"\n'
        "[[configuration]]\nmass = 0.027\n"
        f'flights = [{{ file = "{recording}", columns = {{ {columns} }} }}]\n',
        encoding="utf-8",
    )
    return quietly_identified(path)


def test_the_paper_preset_takes_motion_capture(tmp_path):
    """With quiet cameras: at 2 mrad its total least squares takes 10 % off Iyy."""
    flight = flown("noisy", tmp_path, vehicle="B", attitude_std=5e-4)
    result = identified(tmp_path, flight, 'preset = "paper"\nsource = "mocap"')
    errors = errors_of(result, flight.truth)
    assert abs(errors["kt"]) < 0.001
    assert max(abs(errors[name]) for name in ("msx", "msy", "Ixx", "Iyy")) < 0.02
    assert result.parameter("motor_delay").value == pytest.approx(DELAY, abs=1e-3)
