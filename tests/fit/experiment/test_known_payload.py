"""A known payload links two configurations: what it adds, how well, and what it buys."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.errors import ExperimentError, FlightWarning
from rotorfit.estimation.factors import time_block_factors
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.experiment.payload import MOMENTS, PointMass, added_moments, tolerances
from rotorfit.fit.joint.joint_map import joint_map
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.identification import identify
from rotorfit.model.regressor import regressor
from rotorfit.simulation import paper_vehicle, with_payload, write_flight_table

BALLAST = (
    PointMass(mass=0.125, position=(0.372, 0.0, -0.028), mass_std=5e-4, position_std=0.002),
    PointMass(mass=0.042, position=(0.0, -0.40, -0.028), mass_std=5e-4, position_std=0.002),
)
PAYLOAD = """\
payload_of = "A"
payload = [
  { mass = 0.125, position = [0.372, 0.0, -0.028], mass_std = 0.0005, position_std = 0.002 },
  { mass = 0.042, position = [0.0, -0.40, -0.028], mass_std = 0.0005, position_std = 0.002 },
]
"""


def test_point_masses_add_what_the_simulator_adds():
    bare, _ = paper_vehicle("A")
    loaded = bare
    for item in BALLAST:
        loaded = with_payload(loaded, mass=item.mass, position=item.position)
    added = added_moments(BALLAST)
    before, after = bare.parameters(), loaded.parameters()
    for name in MOMENTS:
        assert added[name] == pytest.approx(after[name] - before[name], abs=1e-15), name


def test_tolerances_are_the_derivatives():
    for name, _, effect in tolerances(BALLAST):
        number, what = int(name.split("_")[1]) - 1, name.split("_")[2]
        item, h = BALLAST[number], 1e-6

        def moved(step, item=item, what=what, number=number):
            if what == "mass":
                other = replace(item, mass=item.mass + step)
            else:
                place = np.array(item.position) + step * np.eye(3)["xyz".index(what)]
                other = replace(item, position=tuple(place.tolist()))
            rest = [*BALLAST[:number], other, *BALLAST[number + 1 :]]
            return added_moments(rest)

        up, down = moved(h), moved(-h)
        for moment in MOMENTS:
            slope = (up[moment] - down[moment]) / (2 * h)
            assert effect[moment] == pytest.approx(slope, abs=1e-8), (name, moment)


def test_the_loaded_body_is_the_bare_one_plus_the_payload():
    _, vehicle = paper_vehicle("A")
    model = regressor(vehicle)
    nothing = time_block_factors(np.ones((1, len(model.layout))), block_rows=1)
    bare = JointConfiguration(name="A", mass=1.285, factors=nothing, model=model, vehicle=vehicle)
    exact = tuple(replace(item, mass_std=0.0, position_std=0.0) for item in BALLAST)
    loaded = replace(bare, name="B", mass=1.452, payload=exact, payload_of="A")
    added = added_moments(exact)
    for order in ((bare, loaded), (loaded, bare)):
        mapped = joint_map(order)
        phi = np.random.default_rng(0).normal(size=len(mapped.names))
        theta = mapped.theta(phi)
        a, b = [c.name for c in order].index("A"), [c.name for c in order].index("B")
        for name in MOMENTS:
            place = bare.model.names.index(name)
            assert theta[b, place] == pytest.approx(theta[a, place] + added[name], abs=1e-12)
        bias = np.array([phi[mapped.names.index(f"accel_bias_{x}@B")] for x in "xyz"])
        ms = np.array([theta[b, bare.model.names.index(f"ms{x}")] for x in "xyz"])
        torque = np.array([theta[b, bare.model.names.index(f"M{x}_0")] for x in "xyz"])
        np.testing.assert_allclose(torque, np.cross(ms, bias), atol=1e-12)


@pytest.fixture(scope="module")
def two_flights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("payload")
    for name in ("A", "B"):
        flight = flown.simulated(name, "noisy", seed=11, seconds=40.0)
        write_flight_table(flight, folder / f"{name}.csv")
    return folder


def experiment_text(folder, link, *, mass=1.452):
    vehicle = paper_vehicle("A").vehicle
    text = f"""{flown.airframe_table(vehicle)}
[motors]
delay = 0.0
[[configuration]]
name = "A"
mass = 1.285
flights = ["A.csv"]
[[configuration]]
name = "B"
mass = {mass}
flights = ["B.csv"]
{link}"""
    path = folder / "experiment.toml"
    path.write_text(text)
    return path


def identified(folder, link):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        return identify(load_experiment(experiment_text(folder, link)))


def half_width(number):
    return 0.5 * (number.interval[1] - number.interval[0])


def test_a_known_payload_sharpens_kd_and_the_height_of_the_com(two_flights):
    unknown, known = identified(two_flights, ""), identified(two_flights, PAYLOAD)
    truth = {name: paper_vehicle(name).truth.parameters() for name in ("A", "B")}
    for name, owner in (("kd", None), ("msz", "A"), ("Izz", "B")):
        wide, sharp = unknown.parameter(name, owner), known.parameter(name, owner)
        assert half_width(sharp) < 0.95 * half_width(wide), (name, owner)
        true = truth[owner or "A"][name]
        assert abs(sharp.value - true) < 1.3 * half_width(sharp), (name, owner)


@pytest.mark.parametrize(
    ("true", "declared"),
    [
        ("[0.372, 0.0, -0.028]", "[-0.372, 0.0, -0.028]"),
        ("[0.372, 0.0, -0.028]", "[0.0, 0.372, -0.028]"),
        ("[0.372, 0.0, -0.028]", "[0.186, 0.0, -0.028]"),
    ],
)
def test_a_misplaced_payload_leaves_no_wrong_number(two_flights, true, declared):
    assert true in PAYLOAD
    result = identified(two_flights, PAYLOAD.replace(true, declared))
    assert "doubt" in [one.severity for one in result.findings if one.kind == "payload"]
    for name in ("A", "B"):
        for number, value in paper_vehicle(name).truth.parameters().items():
            found = [p for p in (*result.parameters, *result.derived) if p.name == number]
            for one in found:
                if one.configuration in (None, name) and one.verdict == "identified":
                    assert abs(one.value - value) < 1.3 * half_width(one), one.full_name


@pytest.mark.parametrize(
    ("link", "mass", "words"),
    [
        ('payload_of = "A"', 1.452, "payload and payload_of belong together"),
        (PAYLOAD.replace('"A"', '"C"'), 1.452, "payload_of = 'C' must name another"),
        (PAYLOAD.replace('"A"', '"B"'), 1.452, "payload_of = 'B' must name another"),
        (PAYLOAD, 1.6, "weighs 0.315 kg more than 'A', but its payload 0.167 kg"),
        (PAYLOAD, 1.465, "weighs 0.180 kg more than 'A', but its payload 0.167 kg"),
        (PAYLOAD.replace("0.125", "-0.125"), 1.452, "should be greater than 0"),
        (PAYLOAD.replace("0.372", "372.0"), 1.452, "the payload is 372 m from the body origin"),
    ],
)
def test_payloads_that_cannot_be_are_refused(tmp_path, link, mass, words):
    with pytest.raises(ExperimentError, match=re.escape(words)):
        load_experiment(experiment_text(tmp_path, link, mass=mass))


def test_a_payload_says_what_its_vehicle_weighs(tmp_path):
    path = experiment_text(tmp_path, PAYLOAD)
    path.write_text(
        re.sub(r"mass = 1.452\n", "", path.read_text(encoding="utf-8")), encoding="utf-8"
    )
    assert load_experiment(path).configuration[1].mass == pytest.approx(1.285 + 0.125 + 0.042)
    bare = path.read_text(encoding="utf-8").replace("mass = 1.285", 'mass = "unknown"')
    path.write_text(bare, encoding="utf-8")
    with pytest.raises(ExperimentError, match="mass is missing"):
        load_experiment(path)
