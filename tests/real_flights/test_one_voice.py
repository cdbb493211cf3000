"""All commands say the same of a number and of a flight, once, and advise nothing that is useless.

What they say is read as a user reads it: from results, texts and next steps of the same log.
"""

import math
import re
import textwrap
from dataclasses import dataclass
from functools import cache

import pytest

import flown
from rotorfit.checks.sensors.log_settings import FAST, TOO_SLOW
from rotorfit.checks.verdicts.judge import FLOWN
from rotorfit.fit.dataset.load import load_flight
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import experiment_of_settings, load_experiment
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION
from rotorfit.logs import read_log
from rotorfit.model.parameters import INERTIA
from rotorfit.report.log_report import prospect_messages, report_text
from rotorfit.report.plan_text import plan_text
from rotorfit.report.text import result_text
from rotorfit.results.compare import compare_results
from rotorfit.results.result import verdict_of
from rotorfit.results.validation.judgement import doubtful_numbers, judgement
from rotorfit.results.validation.replay import IDENTIFIED
from rotorfit.results.validation.replay_vehicle import replay_vehicle
from rotorfit.results.validation.replayed_flights import Timed, replay_flights, validated_flight
from rotorfit.results.validation.validate import fitted_response
from rotorfit.tools.inspection.inspect_log import inspect_log
from rotorfit.tools.inspection.prospects import PROSPECT
from rotorfit.tools.planning.after import judged_numbers
from rotorfit.tools.planning.next_step import next_step
from rotorfit.tools.planning.plan import PlanRequest, plan
from rotorfit.tools.planning.wanted import wanted_accuracy

pytestmark = pytest.mark.flights

CINERAT = """rotors = [
  { position = [-0.0455, -0.0635, 0.0], spin = "cw" },
  { position = [0.0455, -0.0635, 0.0], spin = "ccw" },
  { position = [-0.0455, 0.0635, 0.0], spin = "ccw" },
  { position = [0.0455, 0.0635, 0.0], spin = "cw" },
]"""
PROPS_OUT = """rotors = [
  { position = [-0.12, -0.12, 0.0], spin = "ccw" },
  { position = [0.12, -0.12, 0.0], spin = "cw" },
  { position = [-0.12, 0.12, 0.0], spin = "cw" },
  { position = [0.12, 0.12, 0.0], spin = "ccw" },
]"""
COMMANDED = 'speed = "commanded"\n'


def of_layout(arm, order):
    return f'layout = "quad-x"\narm = {arm}\norder = "{order}"'


def of_hexagon(arm):
    """Motors clockwise from 30 degrees right of the front, as PX4's SIH hexarotor has them."""
    angles = [math.radians(30 + 60 * k) for k in range(6)]
    rows = [
        f"{{ position = [{arm * math.cos(a)}, {-arm * math.sin(a)}, 0.0], "
        f'spin = "{("ccw", "cw")[k % 2]}" }},'
        for k, a in enumerate(angles)
    ]
    return "rotors = [\n" + "\n".join(rows) + "\n]"


HEAVY = """rotors = [
  { position = [0.21, -0.28, 0.0], spin = "ccw" },
  { position = [-0.21, 0.28, 0.0], spin = "ccw" },
  { position = [0.21, 0.28, 0.0], spin = "cw" },
  { position = [-0.21, -0.28, 0.0], spin = "cw" },
]"""
SIH = COMMANDED + "law = { sqrt = { full_speed = 1000, thr_mdl_fac = 0 } }\n"
QUICK = {
    "tudelft-indiflight/LOG00271.BFL": (0.428, CINERAT, ""),
    "betaflight/LOG00037.BFL": ('"unknown"', PROPS_OUT, COMMANDED),
}
LONG = {
    "autopilot-sitl/arducopter-default-logging.BIN": (3.0, of_layout(0.35, "ardupilot"), COMMANDED),
    "autopilot-sitl/arducopter-stock.BIN": (3.0, of_layout(0.35, "ardupilot"), COMMANDED),
    "autopilot-sitl/px4-sih-stock.ulg": (1.0, of_layout(0.2 * 2**0.5, "px4"), SIH),
    "autopilot-sitl/px4-heavy-recommended.ulg": (3.2, HEAVY, COMMANDED),
    "arplab-crazyflie/log15": (0.027, of_layout(0.046, "crazyflie"), COMMANDED),
    "ardupilot-dronekit/log171.bin": ('"unknown"', of_layout(0.25, "ardupilot"), COMMANDED),
    **{
        f"tudelft-indiflight/LOG00{number}.BFL": (0.428, CINERAT, "")
        for number in (230, 257, 264, 267, 275, 340, 341)
    },
    "betaflight/LOG00007.BFL": ('"unknown"', PROPS_OUT, ""),
    "px4-ulog/quadrotor_local.ulg": ('"unknown"', of_layout(0.25, "px4"), COMMANDED),
    "autopilot-sitl/px4-sih-exported.ulg": (1.4, of_layout(0.25, "px4"), COMMANDED),
    "autopilot-sitl/px4-hex.ulg": (1.7, of_hexagon(0.3), COMMANDED),
    "autopilot-sitl/arducopter-exported.BIN": (1.4, of_layout(0.25, "ardupilot"), COMMANDED),
    "autopilot-sitl/ap-heavy-recommended.BIN": (3.2, HEAVY, COMMANDED),
    "autopilot-sitl/ap-heavy-raw.BIN": (3.2, HEAVY, COMMANDED),
}
LESS = {
    ("tudelft-indiflight/LOG00230.BFL", "kd_over_Izz"),
    ("tudelft-indiflight/LOG00340.BFL", "kd_over_Izz"),
}
"""Calm throws of which rows alone tell less about yaw than the whole likelihood: 230's by their
formal deviation already, and 340's by the motors' small part in the motion."""
NARROWER = {"autopilot-sitl/arducopter-exported.BIN"}
"""Its stated law is wrong, which looks like drag to the rows: kt's width is that of the weight."""
LOGS = QUICK | LONG
CASES = [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)]


@dataclass(frozen=True, kw_only=True)
class Said:
    """What the commands make of one log."""

    path: object
    experiment: object
    result: object
    report: object

    @property
    def texts(self):
        return {"identify": result_text(self.result), "inspect": report_text(self.report)}


@pytest.fixture(scope="module")
def said_of(flight_data_dir, tmp_path_factory):
    @cache
    def said(name):
        log = flight_data_dir / name
        if not log.is_file():
            pytest.skip(f"no {log}")
        mass, airframe, motors = LOGS[name]
        path = tmp_path_factory.mktemp("voice") / "experiment.toml"
        path.write_text(
            f"[airframe]\n{airframe}\n[motors]\n{motors}[[configuration]]\nmass = {mass}\n"
            f'flights = ["{log}"]\n',
            encoding="utf-8",
        )
        return Said(
            path=path,
            experiment=load_experiment(path),
            result=flown.advised(flown.quietly_identified(path)),
            report=inspect_log(read_log(log)),
        )

    return said


MEANT = {
    "inertia about z": ("Izz",),
    "inertia": INERTIA,
    "centre of mass": ("msx", "msy"),
    **{name: (name,) for name in ("kt", "kd", "Jr", "Izz")},
}


def disowned(words):
    """List the parameters that a sentence says not to trust."""
    found = set()
    for clause in re.findall(r"do not trust ([^.;:]*)", words):
        for name, meant in MEANT.items():
            if re.search(rf"\b{name}\b", clause):
                found |= set(meant)
                clause = clause.replace(name, "")
    return found


@pytest.mark.parametrize("name", CASES)
def test_no_number_stands_next_to_its_own_doubt(said_of, name):
    result = said_of(name).result
    words = " ".join(result.warnings)
    for one in (*result.parameters, *result.derived):
        base = one.name.removesuffix("_com").replace("com_", "ms")
        if base in disowned(words):
            assert verdict_of(result, one) not in ("identified", "weak"), one.name
    compared = compare_results([result, result], ["a", "b"]).numbers
    shown = {(n.name, n.configuration): n.entries[1].verdict for n in compared}
    for one in result.parameters:
        if one.value is not None:
            assert shown[one.name, one.configuration] == one.verdict


@pytest.mark.parametrize("name", CASES)
def test_the_doctor_foresees_the_verdicts(said_of, name):
    said = said_of(name)
    found, result = said.report.prospects, said.result
    verdicts = {p.name: p.verdict for p in result.parameters}
    verdicts["kd_over_Izz"] = result.derived_value("kd_over_Izz").verdict
    axes = dict(zip(("Ixx", "Iyy", "kd_over_Izz"), found.excitation, strict=True))
    prospects = {number: axis.prospect for number, axis in axes.items()}
    for number, prospect in {"kt": found.thrust.prospect, **prospects}.items():
        said_then = PROSPECT.get(verdicts[number], prospect)
        assert (prospect, said_then) != ("well", "not"), number
        if (name, number) not in LESS:
            assert (prospect, said_then) != ("not", "well"), number
    kt = result.parameter("kt")
    if found.thrust.prospect == "well" and kt.verdict == "identified" and name not in NARROWER:
        half_width = 0.5 * (kt.interval[1] - kt.interval[0]) / kt.value
        assert 0.4 < found.thrust.width / half_width < 2.5


@pytest.mark.parametrize("name", CASES)
def test_no_identified_axis_is_said_to_be_still(said_of, name):
    result = said_of(name).result
    reasons = " ".join(p.reason or "" for p in (*result.parameters, *result.derived))
    for number, axis in (("Ixx", "roll"), ("Iyy", "pitch")):
        if result.parameter(number).verdict == "identified":
            assert result.diagnostics[f"excitation_{axis}@A"] > LEAST_EXCITATION
            assert f"too little of the motion in {axis}" not in reasons


@pytest.mark.parametrize("name", CASES)
def test_the_same_first_step_is_a_setting_everywhere(said_of, name):
    said = said_of(name)
    steps = [said.report.next_step, next_step(said.result)]
    assert len({step.action for step in steps if step.kind == "log"}) <= 1
    assert (steps[0].kind == "log") <= (steps[1].kind == "log")


@pytest.mark.parametrize("name", QUICK)
def test_inspect_with_the_vehicle_ends_as_identify(said_of, flight_data_dir, name):
    """With the mass unknown: the manoeuvre and the verdicts do not depend on it."""
    said = said_of(name)
    looked = inspect_log(read_log(flight_data_dir / name), airframe=said.path)
    assert looked.next_step.sentence == next_step(said.result).sentence
    verdicts = {n: text for text in looked.verdicts for n in text.rpartition(": ")[2].split(", ")}
    for one in said.result.parameters:
        if one.name != "mass":
            assert f": {one.verdict}: " in verdicts[one.name], one.name


@pytest.mark.parametrize("name", CASES)
def test_nothing_useless_is_advised(said_of, name):
    said = said_of(name)
    first = next_step(said.result)
    useless = [one for one in said.result.findings if one.kind == TOO_SLOW]
    for one in said.result.parameters:
        if useless and one.name in FAST:
            assert one.advice not in FLOWN.values(), one.name
    if useless:
        assert first.kind == "log"
        messages = " ".join(prospect_messages(said.report.prospects))
        assert "fly more" not in messages and "hide the motion" not in messages
    if first.gain is not None:
        widths = re.findall(r"from (?:unknown|\+-([\d.]+)) to \+-([\d.]+) (?:%|mm)", first.gain)
        assert widths
        assert all(float(after) < float(now or 100.0) for now, after in widths)


def clauses(text):
    """Split the lists of a text into clauses of eight words and more, without line breaks."""
    items = re.split(r"\n +- ", textwrap.dedent(text))[1:]
    items = [" ".join(item.split("\n\n")[0].split()) for item in items]
    parts = [part.strip() for item in items for part in re.split(r"[;.] |: ", item)]
    return [part for part in parts if len(part.split()) >= 8]


@pytest.mark.parametrize("name", CASES)
def test_no_sentence_is_said_twice(said_of, name):
    for command, text in said_of(name).texts.items():
        found = clauses(text)
        assert len(found) > 3
        twice = {one for one in found if found.count(one) > 1}
        assert not twice, command


def test_what_is_said_twice_is_found():
    words = "until then the inertia of this vehicle is not known well"
    assert clauses(f"Head\n  - a: {words}\n    again; {words}\n\nNext\n  - {words}.") == [
        f"{words} again", words, f"{words}.",
    ]  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_validate_and_fly_judge_a_flight_alike(said_of, name):
    said = said_of(name)
    [configuration] = said.experiment.configuration
    result, owner = said.result, configuration.name
    # As the result has it: the law may be the one that the flight has shown.
    used = load_flight(configuration.flights[0], experiment_of_settings(result.settings))
    compared, replays = validated_flight(result, used)
    doubtful = doubtful_numbers(result, owner)
    validated = judgement(replays, comparisons=() if replays else (compared,), doubtful=doubtful)
    if not replays:  # which fly refuses, for want of numbers
        assert "unknown" in {one.level for one in validated.axes}
        return
    timed = Timed(vehicle=replay_vehicle(result, owner, draws=10), response=fitted_response(result))
    again = replay_flights(result, owner, {IDENTIFIED: timed})
    assert judgement(again, doubtful=doubtful).sentence == validated.sentence


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in LOGS if LOGS[n][0] != '"unknown"'])
def test_the_plan_after_it_says_the_same(said_of, name):
    said = said_of(name)
    [configuration] = said.experiment.configuration
    made = plan(
        PlanRequest(
            name="vehicle.toml",
            vehicle=vehicle_of(said.experiment.airframe),
            mass=configuration.mass,
            speed=said.experiment.motors.speed,
            wanted=wanted_accuracy("5"),
            seconds=(20.0,),
            payload=0.0,
            after=said.result,
        )
    )
    assert next_step(said.result).sentence in " ".join(plan_text(made, width=10_000).split())
    shown = {one.full_name: one.advice for one in judged_numbers(said.result, configuration.name)}
    assert {m.full_name: m.advice for m in made.missing}.items() <= shown.items()
    for one in made.missing:
        assert one.now is None or one.relative <= one.now
        assert one.verdict != "identified"
