"""Simulated experiments: the same seed the same bytes, and what flew is found in the files."""

import functools
import json
import tomllib
import warnings

import numpy as np
import pytest

from rotorfit.errors import ExperimentError, FlightWarning
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.logs.table import read_table
from rotorfit.simulation.experiment_files import (
    experiment_files,
    experiment_text,
    file_names,
    table_text,
)
from rotorfit.simulation.experiments import (
    LAW,
    battery_volts,
    command_of,
    fly,
    plan_experiment,
    planned_flights,
)

SCENARIOS = ("paper", "single", "hexa", "payload-pair")
VARIANTS = ("clean", "lag", "noisy", "real")
QUICK = (("single", "noisy"), ("single", "real"), ("hexa", "real"))
MATRIX = [
    # What repeats these is for the longer studies.
    pytest.param(s, v, marks=() if (s, v) in QUICK else pytest.mark.slow)
    for s in SCENARIOS
    for v in VARIANTS
]
EXACT_VARIANTS = ["clean", pytest.param("lag", marks=pytest.mark.slow)]
EXACT = ("kt", "kd", "Ixx", "Iyy", "Izz")


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory):
    """Fly each experiment once for 20 s, and return the folder with its files."""
    made = {}

    def folder(scenario, variant):
        if (scenario, variant) not in made:
            target = tmp_path_factory.mktemp(f"{scenario}-{variant}")
            plan = plan_experiment(scenario, variant, seed=3, seconds=20.0)
            for name, text in experiment_files(plan).items():
                (target / name).write_text(text, newline="\n")
            made[scenario, variant] = target
        return made[scenario, variant]

    return folder


@pytest.fixture(scope="module")
def result_of(folder_of):
    """Identify each experiment as its file says, once."""
    return functools.cache(lambda scenario, variant: identified(folder_of(scenario, variant)))


def identified(folder, **settings):
    experiment = load_experiment(folder / "experiment.toml")
    identification = experiment.identification.model_copy(update=settings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        return identify(experiment.model_copy(update={"identification": identification}))


def truth_in(folder):
    return json.loads((folder / "truth.json").read_text())


def errors(result, folder, names=EXACT):
    """Return the relative error of each number that the result knows."""
    truth = truth_in(folder)
    found = {}
    for p in (*result.parameters, *result.derived):
        if p.name in names and p.value is not None:
            own = truth["shared"] if p.configuration is None else truth["configurations"]
            true = own[p.name] if p.configuration is None else own[p.configuration][p.name]
            found[p.name, p.configuration] = p.value / true - 1.0
    return found


def test_same_seed_same_bytes():
    plan = plan_experiment("single", "real", seed=5, seconds=15.0)
    again = plan_experiment("single", "real", seed=5, seconds=15.0)
    other = plan_experiment("single", "real", seed=6, seconds=15.0)
    files = experiment_files(plan)
    assert files == experiment_files(again)
    assert list(files) == file_names(plan) == ["A1.csv", "A2.csv", "experiment.toml", "truth.json"]
    assert files["A1.csv"] != table_text(other, fly(other, planned_flights(other)[0]))
    assert files["A1.csv"] != files["A2.csv"]
    assert files["experiment.toml"] == experiment_text(plan)


@pytest.mark.parametrize(("scenario", "variant"), MATRIX)
def test_every_scenario_and_variant_identifies(folder_of, result_of, scenario, variant):
    folder, result = folder_of(scenario, variant), result_of(scenario, variant)
    found = errors(result, folder, ("kt", "Ixx_com", "Iyy_com"))
    configurations = 1 if scenario in ("single", "hexa") else 2
    assert len(found) == 1 + 2 * configurations
    for name, error in found.items():
        assert abs(error) < 0.04, (name, error)
    assert len(result.validation) == configurations
    for row in result.validation:
        assert row["relative_error"]["Fz"] < 0.02


@pytest.mark.parametrize("variant", EXACT_VARIANTS)
def test_paper_experiment_is_recovered_where_nothing_is_wrong(folder_of, variant):
    folder = folder_of("paper", variant)
    found = errors(identified(folder), folder)
    assert len(found) == 2 + 2 * 3
    for name, error in found.items():
        assert abs(error) < 5e-4, (name, error)


@pytest.mark.parametrize("variant", EXACT_VARIANTS)
def test_paper_preset_with_every_parameter(folder_of, variant):
    """r_sigma out of reach: nothing is removed, and little is wrong."""
    folder = folder_of("paper", variant)
    found = errors(identified(folder, preset="paper", r_sigma=1e12), folder)
    assert len(found) == 2 + 2 * 3
    for name, error in found.items():
        assert abs(error) < 1e-3, (name, error)


@pytest.mark.parametrize("variant", EXACT_VARIANTS)
def test_paper_preset_as_printed(folder_of, variant):
    """Without noise k_t is so sharp that r_sigma = 250 removes what else is there.

    Of what stays, k_t is right; the first moments take over what was removed.
    """
    folder = folder_of("paper", variant)
    result = identified(folder, preset="paper")
    assert abs(errors(result, folder)["kt", None]) < 2e-3
    kept = errors(result, folder, ("msx", "msy", "msz"))
    assert all(abs(error) < 0.03 for error in kept.values()), kept
    assert {p.name for p in result.parameters if p.verdict == "removed"} >= {"Ixy", "Ixz", "Iyz"}


def test_truth_is_read_by_nobody(folder_of, result_of):
    folder = folder_of("single", "noisy")
    before = result_of("single", "noisy").to_json()
    hidden = folder / "truth.json"
    text = hidden.read_text()
    hidden.unlink()
    after = identified(folder).to_json()
    hidden.write_text(text)
    assert after == before


@pytest.mark.slow
def test_truth_of_the_paper_vehicles(folder_of):
    truth = truth_in(folder_of("paper", "real"))
    assert (truth["shared"]["kt"], truth["shared"]["kd"]) == pytest.approx((3.63e-6, 5.11e-8))
    assert truth["shared"]["Jr"] == pytest.approx(2e-5)
    A, B = truth["configurations"]["A"], truth["configurations"]["B"]
    assert B["mass"] - A["mass"] == pytest.approx(0.125 + 0.042)
    assert B["msx"] - A["msx"] == pytest.approx(0.125 * 0.372)
    assert B["msy"] - A["msy"] == pytest.approx(-0.042 * 0.40)
    assert truth["shared"]["motor_lag"] == 0.04
    assert truth_in(folder_of("paper", "clean"))["shared"]["motor_lag"] == 0.0


@pytest.mark.slow
def test_payload_pair_keeps_the_centre_of_mass(folder_of):
    own = truth_in(folder_of("payload-pair", "real"))["configurations"]
    A, B = own["A"], own["B"]
    assert (B["msx"], B["msy"], B["msz"]) == pytest.approx((A["msx"], A["msy"], A["msz"]))
    assert B["Ixy"] - A["Ixy"] == pytest.approx(-2 * 0.1 * 0.25**2 / 2)
    assert B["Izz"] - A["Izz"] == pytest.approx(2 * 0.1 * 0.25**2)


@pytest.mark.slow
def test_flight_stays_in_the_hall():
    plan = plan_experiment("paper", "real", seed=1)
    for flight in planned_flights(plan)[::2]:  # one of each vehicle
        flew = fly(plan, flight)
        in_the_air = flew.position[flew.airborne]
        assert (np.ptp(in_the_air, axis=0) < (6.0, 4.0, 4.0)).all()
        assert np.count_nonzero(flew.airborne) / flew.sample_rate > 60.0
        lively = flew.time[flew.airborne][len(in_the_air) // 10 : -len(in_the_air) // 10]
        assert flew.position[np.isin(flew.time, lively), 2].min() > 0.0


def test_motion_capture_has_its_own_clock(folder_of):
    log = read_table(folder_of("single", "noisy") / "A1.csv")
    rates = {
        name: 1.0 / float(np.median(np.diff(log.channels[name].time)))
        for name in ("gyro", "position", "attitude")
    }
    assert rates == pytest.approx({"gyro": 200.0, "position": 100.0, "attitude": 100.0})


def test_motion_capture_is_late(folder_of):
    """The measured height lags the height that flew by 8 ms."""
    plan = plan_experiment("single", "noisy", seed=3, seconds=20.0)
    flight = fly(plan, planned_flights(plan)[0])
    frames = read_table(folder_of("single", "noisy") / "A1.csv").channels["position"]
    tried = np.arange(0.0, 0.02, 0.001)
    misfit = [
        np.std(frames.values[:, 1] - np.interp(frames.time - d, flight.time, flight.position[:, 1]))
        for d in tried
    ]
    assert tried[np.argmin(misfit)] == pytest.approx(0.008)


def test_commands_are_speeds_through_the_law():
    speed = np.array([[0.0, 300.0, 932.0, 1300.0]])
    u = command_of(speed)
    assert np.polynomial.polynomial.polyval(u, LAW) == pytest.approx(speed)
    sagged = command_of(speed, np.array([15.2]))
    assert (sagged[0, 1:] > u[0, 1:]).all()


def test_battery_sags_in_the_log_of_real_flights(folder_of):
    log = read_table(folder_of("single", "real") / "A1.csv")
    volts = log.channels["battery"].values[:, 0]
    assert (volts[0], volts[-1]) == pytest.approx((16.6, 15.2))
    assert {"rotor_speed", "command"} <= set(log.channels)
    plan = plan_experiment("single", "real", seed=3, seconds=20.0)
    assert len(battery_volts(fly(plan, planned_flights(plan)[0]))) == len(volts)


@pytest.mark.parametrize("variant", VARIANTS)
def test_experiment_states_what_its_log_needs(variant):
    plan = plan_experiment("single", variant, seed=3, seconds=20.0)
    text = tomllib.loads(experiment_text(plan))
    motors = text["motors"]
    assert motors["speed"] == ("measured" if variant == "real" else "commanded")
    if variant != "real":
        assert motors["law"]["polynomial"] == list(LAW)
        stated = {"clean": (0.0, 0.0), "lag": (0.04, 0.01), "noisy": (None, None)}
        assert (motors.get("lag"), motors.get("delay")) == stated[variant]
    assert text["identification"] == {"method": "banded"}


@pytest.mark.parametrize("seconds", [0.0, 14.9, 1e6, float("nan")])
def test_useless_durations_are_refused(seconds):
    with pytest.raises(ExperimentError, match="simulate between 15 and 1000 s"):
        plan_experiment("single", "clean", seed=1, seconds=seconds)
