"""rotorfit airframe: questions answered at the prompt, by options, and by a log."""

import io
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "logs"))
from ulog_encoder import write_ulog

import rotorfit
from hand_made_logs import hover_thrust, motion_log
from rotorfit.cli.airframe import _shown_by_flight as shown_by_flight
from rotorfit.cli.airframe import _shown_by_names as shown_by_names
from rotorfit.cli.airframe_text import listed_text, proposal_text
from rotorfit.fit.experiment.airframe_table import AirframeEntry
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.logs.formats import ReadOptions
from rotorfit.logs.proposal import propose_columns
from rotorfit.model.vehicle import layout_rotors, spaced_rotors
from rotorfit.tools.inspection.flown_part import SPINS_UNSURE
from rotorfit.tools.inspection.seen_airframe import seen_airframe

POSED = {"t", "px", "py", "pz", "qx", "qy", "qz", "qw", *(f"motor_motor_m{i}" for i in range(1, 5))}
"""Of NanoBench's table, what a camera and the radio see."""


@pytest.fixture
def answered(run, monkeypatch):
    """Call the command with answers at its prompt."""

    def outcome(answers: str, *arguments: object):
        monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
        return run("airframe", *arguments)

    return outcome


def vehicle(path) -> rotorfit.Vehicle:
    tables = tomllib.loads(path.read_text())
    return rotorfit.vehicle_of(AirframeEntry.model_validate(tables["airframe"]))


def test_questions_are_asked_one_by_one_and_the_file_is_written(answered, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = answered("quad-x\nbetaflight\n91\n127\n\n\n")
    assert ended.code == 0
    assert ended.err.count("]: ") == 5  # the order has no default
    assert ended.out.startswith("[airframe]\n")
    made = vehicle(tmp_path / "airframe.toml")
    places = np.array([rotor.position for rotor in made.rotors])
    np.testing.assert_allclose(np.abs(places[:, 0]), 0.0455)
    np.testing.assert_allclose(np.abs(places[:, 1]), 0.0635)
    assert [r.spin for r in made.rotors] == ["cw", "ccw", "ccw", "cw"]
    assert "commanded" in (tmp_path / "airframe.toml").read_text()


@pytest.mark.parametrize(("reply", "spin"), [("", "cw"), ("usual\n", "cw"), ("reversed\n", "ccw")])
def test_spins_that_nothing_shows_are_asked_for(
    answered, tmp_path, monkeypatch, reply, spin, assert_wording
):
    monkeypatch.chdir(tmp_path)
    given = ("--layout", "quad-x", "--order", "betaflight", "--speed", "measured")
    ended = answered(reply, *given, "--spacing", "91,127")
    assert ended.code == 0
    assert "Motor 1 (rear" in ended.err
    assert_wording(ended.err)
    assert ("taken as usual" in ended.err) == (reply == "")
    assert vehicle(tmp_path / "airframe.toml").rotors[0].spin == spin


@pytest.mark.parametrize("shown", [True, False])
def test_a_flight_that_hardly_yaws_shows_no_spins(shown):
    confirmed = 'layout = "quad-x", order = "px4" with every spin reversed (list the rotors)'
    seen = seen_airframe(
        motion_log(hover_thrust(4)), confirmed + ("" if shown else f" ({SPINS_UNSURE})")
    )
    assert (seen.borne_out, seen.spins_shown, seen.turned) == (True, shown, shown)
    assert ("but not the spins" in shown_by_flight(seen)) is not shown


def test_wrong_answers_are_asked_again(answered, tmp_path, monkeypatch, assert_wording):
    monkeypatch.chdir(tmp_path)
    ended = answered("quad\nquad-x\npx4\n91, 127\n91\n127\nfast\nmeasured\n")
    assert ended.code == 0
    assert "'quad' is none of quad-x," in ended.err
    assert "crazyflie): " in ended.err  # no order is a default where nothing shows one
    assert "of '91, 127' mm;" in ended.err
    assert "expected 15 to 10000" in ended.err
    assert_wording(ended.err)
    made = tomllib.loads((tmp_path / "airframe.toml").read_text())
    assert (made["airframe"]["spacing"], made["motors"]["speed"]) == ([0.091, 0.127], "measured")


def test_a_log_fills_in_layout_order_and_speed(answered, here, assert_wording):
    ended = answered("400\n\n", "flight.csv", "-o", "mine.toml")
    assert ended.code == 0, ended
    assert_wording(ended.err)
    made = vehicle(here / "mine.toml").rotors
    assert [r.spin for r in made] == ["ccw", "ccw", "cw", "cw"]
    assert np.abs([r.position[:2] for r in made]).max() == 0.2


@pytest.mark.parametrize("motors", [(2, 1, 3, 4), (3, 1, 4, 2), (4, 3, 2, 1)])
def test_the_flight_shows_motors_in_any_order(answered, changed, assert_wording, motors):
    """Who built the controller, too, numbers the motors as he likes."""
    stems = dict(enumerate(motors, start=1))
    path = changed(
        lambda columns: {
            name: columns[f"rotor_{stems[int(name[-1])]}"] if name.startswith("rotor_") else values
            for name, values in columns.items()
            if "command" not in name
        }
    )
    ended = answered("400\n\n", path.name, "-o", "mine.toml")
    assert ended.code == 0, ended
    usual = layout_rotors("quad-plus", arm=0.2, order="paper")
    made = vehicle(Path("mine.toml")).rotors
    assert [(r.position, r.spin) for r in made] == [
        (usual[motor - 1].position, usual[motor - 1].spin) for motor in motors
    ]
    if motors == (2, 1, 3, 4):
        assert_wording(ended.err)


@pytest.mark.parametrize(("spins", "said"), [("reversed", True), ("usual", False)])
def test_spins_that_the_flight_contradicts_are_said(answered, here, spins, said):
    asked = ("flight.csv", "-o", "mine.toml", "--spacing", "400,400")
    ended = answered("", *asked, "--spins", spins)
    assert ended.code == 0, ended
    assert ("yaws like spins" in ended.err) is said
    assert vehicle(here / "mine.toml").rotors[0].spin == ("cw" if said else "ccw")


def test_what_the_flight_does_not_bear_out_is_said(answered, here, assert_wording):
    asked = ("flight.csv", "-o", "mine.toml", "--layout", "quad-x", "--order", "px4")
    ended = answered("", *asked, "--spacing", "200,200")
    assert ended.code == 0
    assert_wording(ended.err)


def test_without_an_answer_nothing_is_written(answered, tmp_path, monkeypatch, assert_wording):
    monkeypatch.chdir(tmp_path)
    ended = answered("")
    assert (ended.code, ended.out) == (1, "")
    assert_wording(ended.err)
    assert not (tmp_path / "airframe.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--spacing", "0.2,0.2"), "a spacing of '0.2' mm; expected 15 to 10000 millimetres"),
        (("--spacing", "200"), "front to back and left to right in mm, such as 91,127"),
        (("--layout", "quad-z", "--spacing", "9,9"), "layout 'quad-z'; expected one of quad-x,"),
        (("--order", "paper", "--spacing", "9,9"), "order 'paper'; expected one of px4,"),
        (
            ("--order", "mine", "--spacing", "9,9"),
            "Of any other order, list the rotors as the log",
        ),
        (("--order", "betafligt", "--spacing", "9,9"), "crazyflie; did you mean betaflight?"),
    ],
)
def test_wrong_answers_are_refused(refused, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    given = {"--layout": "quad-x", "--order": "px4", "--speed": "measured"}
    given |= dict(zip(arguments[::2], arguments[1::2], strict=True))
    assert words in refused("airframe", *(word for pair in given.items() for word in pair))


def test_a_file_that_is_there_stays(refused, here):
    before = (here / "airframe.toml").read_text()
    assert "airframe.toml exists" in refused("airframe")
    assert (here / "airframe.toml").read_text() == before


def test_a_spacing_is_what_an_arm_is_where_the_frame_is_square():
    arm = 0.15
    across = 2 * arm * np.sqrt(0.5)
    for layout, order, spacing in (
        ("quad-x", "px4", (across, across)),
        ("quad-plus", "px4", (2 * arm, 2 * arm)),
        ("octo-coax-x", "ardupilot", (across, across)),
    ):
        told = spaced_rotors(layout, spacing=spacing, order=order)
        for rotor, other in zip(told, layout_rotors(layout, arm=arm, order=order), strict=True):
            assert rotor.spin == other.spin
            np.testing.assert_allclose(rotor.position, other.position, atol=2e-9)


def test_spacing_and_arm_exclude_each_other():
    with pytest.raises(ValueError, match="either spacing"):
        AirframeEntry.model_validate({"layout": "quad-x", "arm": 0.1, "spacing": [0.2, 0.2]})
    with pytest.raises(ValueError, match="either spacing"):
        AirframeEntry.model_validate({"layout": "quad-x"})
    with pytest.raises(ValueError, match="positions and arm are in metres"):
        AirframeEntry.model_validate({"layout": "quad-x", "spacing": [91, 127]})


def test_rotors_that_a_log_lists_are_scaled_to_what_was_measured(tmp_path):
    angles = np.radians([30.0, 90.0, 150.0, 210.0, 270.0, 330.0])
    sites = tuple(
        (round(float(np.cos(a)), 3), -round(float(np.sin(a)), 3), "cw" if i % 2 else "ccw")
        for i, a in enumerate(angles)
    )
    path = tmp_path / "airframe.toml"
    path.write_text(listed_text(sites, (0.5196, 0.6), speed="commanded", source="a log"))
    made = vehicle(path).rotors
    places = np.array([rotor.position for rotor in made])
    np.testing.assert_allclose(np.hypot(places[:, 0], places[:, 1]), 0.3, rtol=1e-3)
    np.testing.assert_allclose(
        np.arctan2(-places[:, 1], places[:, 0]) % (2 * np.pi), angles, atol=1e-3
    )
    assert [rotor.spin for rotor in made] == ["ccw", "cw"] * 3
    assert tomllib.loads(path.read_text())["motors"]["speed"] == "commanded"


def test_of_rotors_in_the_parameters_only_the_size_is_asked_for(
    answered, flight_data_dir, tmp_path, assert_wording
):
    log = flight_data_dir / "autopilot-sitl" / "px4-hex.ulg"
    if not log.is_file():
        pytest.skip(f"no {log}")
    ended = answered("519.6\n600\n", log, "-o", tmp_path / "hexa.toml")
    assert ended.code == 0, ended
    assert_wording(ended.err)
    made = vehicle(tmp_path / "hexa.toml").rotors
    assert [rotor.spin for rotor in made] == ["ccw", "cw"] * 3
    assert made[1].position == pytest.approx((0.0, -0.3, 0.0))


@pytest.fixture
def own_geometry(simulated, tmp_path):
    """A log of PX4 whose parameters have the vehicle's own rotors."""
    path = tmp_path / "own.ulg"
    write_ulog(simulated, path)
    return path


def test_rotors_that_somebody_set_in_px4_need_no_ruler(
    answered, own_geometry, simulated, tmp_path, assert_wording
):
    ended = answered("", own_geometry, "-o", tmp_path / "own.toml")
    assert ended.code == 0, ended
    assert_wording(ended.err)
    made, true = vehicle(tmp_path / "own.toml").rotors, simulated.vehicle.rotors
    assert [r.spin for r in made] == [r.spin for r in true]
    for one, other in zip(made, true, strict=True):
        assert one.position == pytest.approx(other.position, abs=1e-6)


def test_identify_takes_them_off_the_log_itself(run, own_geometry, assert_wording):
    ended = run("identify", own_geometry, "--mass", "1.285", "--json")
    assert ended.code == 0, ended.err
    assert "log: 4, arms" in ended.err
    assert "of 0.2 m," in ended.err
    assert_wording(ended.err)
    assert len(json.loads(ended.out)["settings"]["airframe"]["rotors"]) == 4


@pytest.fixture
def unknown(here, columns) -> Path:
    """The flight as a ground station of somebody's own writes it: FRD, g, deg/s, rpm."""
    own = {"Time (us)": 1e6 * columns["time"]}
    for axis, sign in zip("xyz", (1, -1, -1), strict=True):
        own[f"IMU0.gyro{axis.upper()} [deg/s]"] = np.degrees(sign * columns[f"gyro_{axis}"])
        own[f"a{axis}"] = sign * columns[f"accel_{axis}"] / 9.80665
    own |= {f"esc{i}": 30 / np.pi * columns[f"rotor_{i + 1}"] for i in range(4)}
    rows = np.array([*own.values()]).T
    np.savetxt(here / "own.csv", rows, fmt="%.9g", delimiter=";", header=";".join(own), comments="")
    return here / "own.csv"


def test_an_unknown_table_is_mapped_once_and_read_ever_after(
    answered, run, unknown, assert_wording
):
    refusal = run("inspect", "own.csv")
    assert (refusal.code, "rotorfit airframe" in refusal.err) == (1, True)
    ended = answered("rpm\n", "own.csv", "--spacing", "400,400", "-o", "own.toml")
    assert ended.code == 0, ended
    assert "says axes FRD (z down)" in ended.err
    assert "Unit of esc0 to esc3" in ended.err
    assert_wording(ended.err)
    made = tomllib.loads(Path("own.toml").read_text())["table"]
    assert made["axes"] == "FRD"
    assert made["columns"]["rotor_1"] == {"name": "esc0", "unit": "rpm"}
    assert run("inspect", "own.csv", "--airframe", "own.toml").code == 0
    Path("plain.toml").write_text(Path("own.toml").read_text().partition("# how tables")[0])
    own, plain = (
        json.loads(run("identify", log, "--mass", "1.285", "--airframe", file, "--json").out)
        for log, file in (("own.csv", "own.toml"), ("flight.csv", "plain.toml"))
    )
    mapped, direct = ({p["name"]: p["value"] for p in r["parameters"]} for r in (own, plain))
    assert mapped["kt"] == pytest.approx(direct["kt"], rel=1e-3)
    assert mapped["Ixx"] == pytest.approx(direct["Ixx"], rel=1e-2)


@pytest.mark.parametrize(
    ("names", "given", "shown"),
    [
        (("n_fr", "n_rl", "n_fl", "n_rr"), (None, None), ("quad-x", "px4")),
        (("n_fr", "n_rl", "n_fl", "n_rr"), (None, "betaflight"), ("quad-x", "betaflight")),
        (("m1", "m2", "m3", "m4"), (None, None), (None, None)),
        (("n_fr", "n_rl", "n_fl", "m4"), (None, None), (None, None)),
    ],
)
def test_columns_named_by_corners_answer_layout_and_order(unknown, names, given, shown):
    """The names say which motor is where, so that nobody is asked for it."""
    text = unknown.read_text()
    for i, name in enumerate(names):
        text = text.replace(f"esc{i}", name)
    unknown.write_text(text)
    proposal = propose_columns(unknown, units={"motors": "rpm"})
    assert shown_by_names(ReadOptions(columns=proposal.columns), *given) == shown


def test_long_names_of_columns_keep_their_ends(unknown):
    text = unknown.read_text()
    for axis in "xyz":
        text = text.replace(f";a{axis};", f";/drone/imu/linear_acceleration/{axis};")
    unknown.write_text(text)
    shown = proposal_text(propose_columns(unknown, units={"motors": "rpm"}))
    assert all(f"inear_acceleration/{axis}  g" in shown for axis in "xyz")


def test_poses_and_motors_need_no_imu(run, flight_data_dir, tmp_path, monkeypatch, assert_wording):
    """NanoBench's table without its IMU: proposed, written down, and identified by its poses."""
    recording = flight_data_dir / "nanobench-crazyflie" / "B8_star_fast_rep1.csv"
    if not recording.is_file():
        pytest.skip(f"no {recording}")
    monkeypatch.chdir(tmp_path)
    rows = [line.split(",") for line in recording.read_text(encoding="utf-8").split()]
    kept = [i for i, name in enumerate(rows[0]) if name in POSED]
    lines = [",".join(row[i] for i in kept) for row in rows]
    Path("own.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    shape = ("--layout", "quad-x", "--order", "crazyflie", "--spacing", "65,65")
    ended = run("airframe", "own.csv", "--unit", "motors=counts", *shape, "-o", "own.toml")
    assert ended.code == 0, ended
    assert_wording(ended.err)
    assert "CHECK" not in ended.err
    found = run("identify", "own.csv", "--mass", "0.033", "--airframe", "own.toml", "--json")
    assert found.code == 0, found.err
    result = json.loads(found.out)
    assert result["settings"]["identification"]["source"] == "mocap"
    kt = next(p for p in result["parameters"] if p["name"] == "kt")
    # At full command, 0.108 where thrust goes with the squared command: no law is given.
    assert kt["value"] == pytest.approx(0.0989, rel=0.01)
    assert kt["std"] > 0.02 * kt["value"]
    refused = run(
        "identify", "own.csv", "--mass", "0.033", "--airframe", "own.toml", "--source", "imu"
    )
    assert (refused.code, "--source mocap" in refused.err) == (1, True)


def test_a_wrong_proposal_is_put_right_by_options(run, unknown, assert_wording):
    given = ("airframe", "own.csv", "--spacing", "400,400", "--unit", "motors=rpm")
    shape = ("--layout", "quad-plus", "--order", "paper")
    ended = run(*given, *shape, "--unit", "accel=m/s^2", "--axes", "FLU", "-o", "own.toml")
    assert ended.code == 0, ended
    assert "in m/s^2 feels 1" in ended.err
    assert_wording(ended.err)
    assert "of -1" in ended.err
    made = tomllib.loads(Path("own.toml").read_text())["table"]
    assert (made["axes"], made["columns"]["accel_x"]) == ("FLU", {"name": "ax", "unit": "m/s^2"})


def test_an_experiment_file_has_the_columns_of_its_tables(run, unknown):
    """Each of its flights that needs them takes them; its [table] serves other logs as well."""
    run("airframe", "own.csv", "--spacing", "400,400", "--unit", "motors=rpm", "-o", "own.toml")
    flights = (
        '[[configuration]]\nmass = 1.285\nflights = ["own.csv"]\nvalidation = ["flight.csv"]\n'
    )
    text = Path("own.toml").read_text() + flights
    Path("experiment.toml").write_text(text)
    entry = load_experiment(Path("experiment.toml")).configuration[0]
    assert entry.flights[0].axes == "FRD"
    assert entry.flights[0].columns["rotor_1"].unit == "rpm"
    assert entry.validation[0].columns is None
    assert run("inspect", "experiment.toml").code == 0
    assert run("inspect", "own.csv", "--airframe", "experiment.toml").code == 0


def test_answers_for_a_table_may_be_options(run, refused, unknown, assert_wording):
    given = ("--spacing", "400,400", "-o", "own.toml")
    stated = run("airframe", "own.csv", *given, "--unit", "motors=erpm", "--poles", "14")
    assert stated.code == 0, stated
    assert tomllib.loads(Path("own.toml").read_text())["motors"]["poles"] == 14
    assert "unit 'furlong' of motors" in refused(
        "airframe", "own.csv", "-o", "b.toml", "--unit", "motors=furlong"
    )
    assert_wording(refused("airframe", "own.csv", "-o", "b.toml", "--column", "gyro_x=nix"))
    assert "exists" in refused("airframe", "own.csv", *given, "--unit", "motors=rpm")


def test_a_wrong_spacing_is_refused_before_the_log_is_read(refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "such as 91,127" in refused("airframe", "missing.bfl", "--spacing", "200")
