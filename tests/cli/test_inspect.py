"""inspect is a doctor: trouble in a readable log is told with exit code 0, an unusable log 1."""

import contextlib
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blackbox_file import blackbox_of
from command_line import AIRFRAME, Columns, called, without

from rotorfit.simulation import (
    STILL,
    Scenario,
    paper_vehicle,
    simulate_flight,
    variant,
    write_flight_table,
)


@pytest.fixture(scope="module")
def blackbox(columns) -> bytes:
    return blackbox_of({name: values[::4] for name, values in columns.items()})


@pytest.fixture(scope="module")
def judged(tmp_path_factory, table_text) -> dict[str, Any]:
    """The report about flight.csv with its airframe."""
    folder, printed = tmp_path_factory.mktemp("judged"), io.StringIO()
    (folder / "flight.csv").write_text(table_text)
    (folder / "airframe.toml").write_text(AIRFRAME)
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        assert called("inspect", "flight.csv", "--airframe", "airframe.toml", "--json") == 0
    [report] = json.loads(printed.getvalue())
    return report


def test_a_good_log(run, here, assert_wording):
    ended = run("inspect", "flight.csv")
    assert (ended.code, ended.err) == (0, "")
    assert "log 1 of 1," in ended.out
    assert "30.0 s\n" in ended.out
    assert_wording(ended.out)
    assert "4 " in ended.out
    assert "6000 " in ended.out
    assert "200 Hz" in ended.out
    assert "airborne: " in ended.out and "nothing found" not in ended.out
    assert "To know" not in ended.out


def test_json_agrees_with_the_text(run, here):
    [report] = run("inspect", "flight.csv", "--json").json
    text = " ".join(run("inspect", "flight.csv").out.split())
    assert [c["name"] for c in report["channels"]] == ["gyro", "accel", "rotor_speed"]
    for channel in report["channels"]:
        assert (channel["samples"], channel["missing"]) == (6000, 0)
        assert channel["rate"] == pytest.approx(200.0)
        assert channel["source"] in text
    [[start, end]] = report["airborne"]
    assert f"airborne: {start:.2f} to {end:.2f} s" in text
    assert report["trouble"] == []


def test_a_missing_airframe_file_is_named_once(run, here):
    ended = run("inspect", "flight.csv", "flight.csv", "--airframe", "none.toml")
    assert (ended.code, ended.err.count("none.toml")) == (1, 1)


def test_motors_by_other_names_are_to_be_proposed(run, refused, here, assert_wording):
    table = Path(here / "flight.csv")
    text = table.read_text(encoding="utf-8").replace("rotor_", "rpm").replace("command_", "u")
    table.write_text(text, encoding="utf-8")
    [report] = run("inspect", "flight.csv", "--json").json
    assert_wording(report["trouble"][0])
    arguments = ("flight.csv", "--mass", "1.285", "--airframe", "airframe.toml")
    assert_wording(refused("identify", *arguments))


def test_a_hover_on_commands_is_foreseen_at_the_usual_lag(run, here, assert_wording):
    """At the lag that fits best, an answer to the gyro's noise looks like a yaw response."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(
        seconds=30.0, ground_seconds=2.0, sensors=sensors, sticks=STILL, gyro_noise_in_loop=True
    )
    flight = simulate_flight(truth, vehicle, scenario, seed=12)
    write_flight_table(flight, here / "hover.csv", channels=("gyro", "accel", "command"))
    text = " ".join(run("inspect", "hover.csv").out.split())
    assert_wording(text)
    for axis in ("roll", "pitch", "yaw"):
        found = rf"- {axis} \([0-9.]+ rad/s\^2\): .*"
        assert re.search(found + r"signal-to-noise (under )?0[.0-9]*, need", text), text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without("rotor_", "command_"), "no motor data"),
        (without("rotor_"), "only commands"),
        (without("gyro", "accel"), "no gyro channel"),
        (lambda c: {n: v[:500] for n, v in c.items()}, "never fl"),
        (lambda c: {n: 0.0 * v if "rotor" in n else v for n, v in c.items()}, "never turn"),
        (lambda c: {n: -v if n[-1] in "yz" else v for n, v in c.items()}, "FRD"),
    ],
    ids=["no motors", "commands only", "no imu", "never airborne", "motors still", "turned"],
)
def test_trouble_is_reported_and_done(run, changed, change, words):
    changed(change)
    ended = run("inspect", "flight.csv", "--json")
    assert (ended.code, ended.err) == (0, "")
    [report] = ended.json
    assert any(words in trouble for trouble in report["trouble"]), report["trouble"]
    text = run("inspect", "flight.csv").out
    assert words in " ".join(text.split())


@pytest.mark.parametrize(
    "change",
    [
        lambda c: {n: v if n == "time" else v * np.nan for n, v in c.items()},
        lambda c: {n: v[:1] for n, v in c.items()},
    ],
    ids=["all nan", "one sample"],
)
@pytest.mark.parametrize("options", [(), ("--json",)], ids=["text", "json"])
def test_no_usable_sample(refused, changed, change, options):
    changed(change)
    assert "flight.csv" in refused("inspect", "flight.csv", *options)


@pytest.mark.parametrize("content", [b"", b"%PDF-1.7\n", bytes(range(256))])
def test_unreadable(refused, here, content):
    (here / "flight.csv").write_bytes(content)
    assert "flight.csv" in refused("inspect", "flight.csv")


def test_one_of_two_cannot_be_read(run, here, assert_text):
    ended = run("inspect", "none.csv", "flight.csv", "--json")
    assert ended.code == 1
    assert [report["file"] for report in ended.json] == ["flight.csv"]
    assert_text(ended.err)


def test_several_logs_are_listed_and_one_is_chosen(
    run, refused, here, blackbox, assert_text, assert_wording
):
    (here / "two.bbl").write_bytes(blackbox + blackbox)
    listed = run("inspect", "two.bbl")
    assert listed.code == 0
    assert listed.out.startswith("two.bbl: 2 logs,")
    assert_wording(listed.out)
    assert_text(listed.out.splitlines()[1])
    [choice] = run("inspect", "two.bbl", "--json").json
    assert [line[:2] for line in choice["logs"]] == ["1:", "2:"]
    chosen = run("inspect", "two.bbl", "--log", "2", "--json")
    assert chosen.code == 0
    assert chosen.json[0]["log"] == "2 of 2"
    assert "3" in refused("inspect", "two.bbl", "--log", "3")


def test_blackbox_cut_in_the_middle_of_a_frame(run, here, blackbox):
    (here / "cut.bbl").write_bytes(blackbox[: len(blackbox) * 3 // 4 + 5])
    ended = run("inspect", "cut.bbl", "--json")
    assert ended.code == 0
    [report] = ended.json
    whole = 1500
    assert 0.7 * whole < report["channels"][0]["samples"] < 0.8 * whole
    assert any("end" in trouble for trouble in report["trouble"]), report["trouble"]


def test_blackbox_cut_inside_its_header(refused, here, blackbox):
    header = blackbox.index(b"H Field I name")
    for stop in (len(b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n"), header):
        (here / "cut.bbl").write_bytes(blackbox[:stop])
        assert "cut.bbl" in refused("inspect", "cut.bbl")


@pytest.mark.flights
@pytest.mark.parametrize(
    "folder", ["betaflight", pytest.param("tudelft-indiflight", marks=pytest.mark.slow)]
)
def test_real_logs(run, flight_data_dir, folder, tmp_path):
    logs = sorted((flight_data_dir / folder).glob("*.BFL"))
    if not logs:
        pytest.skip(f"no logs in {folder}")
    page = tmp_path / "page.html"
    ended = run("inspect", *logs, "--json", "--report", page)
    assert (ended.code, ended.err) == (0, f"rotorfit: wrote {page}\n")
    assert page.stat().st_size < 1e6 * len(logs)
    assert page.read_text(encoding="utf-8").count('data-key="spectrum accel x"') == len(logs)
    reports = json.loads(ended.out)
    assert [Path(report["file"]).name for report in reports] == [log.name for log in logs]
    for report in reports:
        channels = {channel["name"]: channel for channel in report["channels"]}
        assert {"gyro", "accel"} <= set(channels)
        raw = "Unfiltered" in channels["accel"]["source"]
        asked = {setting["name"] for setting in report["settings"]}
        assert ("acc_lpf_hz" in asked) is not raw
        assert {"rotor_speed", "command"} & set(channels)
        assert 400 < channels["gyro"]["rate"] < 1100
        flown = sum(end - start for start, end in report["airborne"])
        assert 5.0 < flown <= report["seconds"]


FAULTS = {
    "swapped motors": (lambda c: {**c, "rotor_1": c["rotor_2"], "rotor_2": c["rotor_1"]}, "order"),
    "FRD called FLU": (lambda c: {n: -v if n[-1] in "yz" else v for n, v in c.items()}, "FRD"),
    "gyro in deg/s": (
        lambda c: {n: np.degrees(v) if n.startswith("gyro") else v for n, v in c.items()},
        "looks like deg/s",
    ),
    "gyro 57 times too small": (
        lambda c: {n: np.radians(v) if n.startswith("gyro") else v for n, v in c.items()},
        "the gyro reads too little",
    ),
    "accelerometer in g": (
        lambda c: {n: v / 9.80665 if n.startswith("accel") else v for n, v in c.items()},
        "units of g",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named_with_an_airframe(run, changed, here, name):
    change, words = FAULTS[name]
    changed(change)
    ended = run("inspect", "flight.csv", "--airframe", "airframe.toml", "--json")
    assert (ended.code, ended.err) == (0, "")
    [report] = ended.json
    assert any(words in trouble for trouble in report["trouble"]), report["trouble"]


def test_an_airframe_gives_verdicts(judged):
    [found] = [words for words in judged["verdicts"] if ": identified: " in words]
    assert found.startswith("with airframe.toml: identified: kt")


def test_the_prospects_of_a_lively_flight(run, here):
    [report] = run("inspect", "flight.csv", "--json").json
    rho = {one["axis"]: one["rho"] for one in report["prospects"]["excitation"]}
    assert rho["roll"] > 5.0 and rho["pitch"] > 5.0
    assert report["prospects"]["motors"].startswith("layout = ")
    assert report["settings"] == []


def test_a_page_is_written_once(run, refused, here):
    ended = run("inspect", "flight.csv", "--report", "page.html")
    assert (ended.code, ended.err) == (0, "rotorfit: wrote page.html\n")
    page = (here / "page.html").read_text(encoding="utf-8")
    assert 'content="width=device-width' in page  # a telephone shows it at its own width
    assert page.index('<div class="scroll"><table') < page.index("</table></div>")
    assert "<h1>flight.csv</h1>" in page and "What this flight can show" in page
    assert "http" not in page.replace("http-equiv", "")
    assert "page.html exists" in refused("inspect", "flight.csv", "--report", "page.html")
    assert run("inspect", "flight.csv", "--report", "page.html", "--force").code == 0


def test_commands_only_get_the_settings_of_their_autopilot(run, here, blackbox):
    (here / "one.bbl").write_bytes(blackbox)
    [report] = run("inspect", "one.bbl", "--json").json
    names = [setting["name"] for setting in report["settings"]]
    speeds = "rotor_speed" in [channel["name"] for channel in report["channels"]]
    assert ("dshot_bidir" in names) is not speeds


def test_a_recording_of_cameras_alone_belongs_next_to_a_log(run, here, assert_wording):
    lines = [f"{0.01 * i} {0.1 * i} 0 1 0 0 0 1" for i in range(200)]
    (here / "take.tum").write_text("\n".join(lines) + "\n", encoding="utf-8")
    [report] = run("inspect", "take.tum", "--json").json
    [words] = report["trouble"]
    assert_wording(words)


def test_poses_next_to_motors_are_for_motion_capture(run, here, assert_wording):
    names = (
        "time pos_x pos_y pos_z quat_w quat_x quat_y quat_z command_1 command_2 command_3 command_4"
    )
    lines = [names.replace(" ", ",")]
    lines += [f"{0.01 * i},{0.1 * i},0,1,1,0,0,0,0.5,0.5,0.5,{0.4 + 0.001 * i}" for i in range(200)]
    (here / "posed.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    [report] = run("inspect", "posed.csv", "--json").json
    cure = 'identify with source = "mocap" if position and attitude are those of motion capture'
    words = f"no gyro channel (rotation rates) and no accel channel (specific force): {cure}"
    assert words in report["trouble"]
    shown = run("inspect", "posed.csv").out
    assert_wording(shown)
    assert_wording(report["next_step"]["action"])


def with_commands(order=(0, 1, 2, 3)):
    """Keep the commands, and give the measured speeds another order."""
    return lambda c: c | {f"rotor_{i + 1}": c[f"rotor_{k + 1}"] for i, k in enumerate(order)}


def test_speeds_that_follow_their_commands(run, changed, assert_wording):
    changed(with_commands())
    [report] = run("inspect", "flight.csv", "--json").json
    rotors = report["telemetry"]["rotors"]
    assert [(r["rotor"], r["state"], r["speed_channel"]) for r in rotors] == [
        (n, "follows", n) for n in (1, 2, 3, 4)
    ]
    assert report["telemetry"]["doubts"] == []
    assert report["trouble"] == []
    text = " ".join(run("inspect", "flight.csv").out.split())
    assert_wording(text)


def test_speeds_in_another_order_than_commands(run, changed):
    changed(with_commands((0, 2, 1, 3)))
    words = "command 2 moves speed 3, command 3 moves speed 2"
    [report] = run("inspect", "flight.csv", "--json").json
    assert any(words in trouble for trouble in report["trouble"]), report["trouble"]
    text = " ".join(run("inspect", "flight.csv").out.split())
    assert words in text
    assert "follows its own command" not in text


def test_one_motor_channel_has_nothing_to_be_compared_with(run, here):
    [report] = run("inspect", "flight.csv", "--json").json
    assert report["telemetry"] is None
    assert "command" not in run("inspect", "flight.csv").out


def test_the_airframe_looks_at_the_chosen_log(run, here, columns):
    flown = blackbox_of(columns)
    ground = blackbox_of({name: values[:400] for name, values in columns.items()})
    (here / "two.bbl").write_bytes(ground + flown)
    (here / "one.bbl").write_bytes(flown)
    options = ("--airframe", "airframe.toml", "--json")
    [chosen] = run("inspect", "two.bbl", "--log", "2", *options).json
    [alone] = run("inspect", "one.bbl", *options).json
    assert alone["verdicts"] != [], alone["trouble"]
    assert chosen["verdicts"] == alone["verdicts"]
    assert chosen["trouble"] == alone["trouble"]


def test_the_scale_of_the_accelerometer_without_an_airframe(run, changed, assert_wording):
    changed(lambda c: {n: 1.07 * v if n.startswith("accel") else v for n, v in c.items()})
    [report] = run("inspect", "flight.csv", "--json").json
    [told] = report["trouble"]
    assert "reads 10." in told
    assert_wording(told)
    assert report["gravity"]["at_rest"] == pytest.approx(1.07, abs=0.02)
    assert report["gravity"]["in_flight"] == pytest.approx(1.07, abs=0.04)


def test_what_needs_an_airframe_is_said_in_one_line(run, here, judged):
    text = " ".join(run("inspect", "flight.csv").out.split())
    assert text.count("rotorfit airframe flight.csv") == 1
    assert judged["not_judged"] == []


def in_pieces(columns: Columns) -> Columns:
    """Leave 0.3 s of every 0.7 s in the air: no piece is long enough for anything."""
    kept = (columns["time"] < 3.0) | (columns["time"] % 0.7 < 0.3)
    return {name: values[kept] for name, values in columns.items()}


def test_a_flight_too_short_for_prospects_is_reported(run, changed, assert_text):
    changed(in_pieces)
    ended = run("inspect", "flight.csv", "--json")
    assert (ended.code, ended.err) == (0, "")
    assert_text(ended.json[0]["trouble"])
    assert ended.json[0]["prospects"] is None


RENAMED = {"gyro_x": "p", "gyro_y": "q", "gyro_z": "r"}


def test_an_experiment_file_names_the_columns(run, changed, here, assert_wording):
    changed(without("command_"))
    text = (here / "flight.csv").read_text(encoding="utf-8")
    head, _, rows = text.partition("\n")
    named = ",".join(RENAMED.get(name, name) for name in head.split(","))
    (here / "flight.csv").write_text(f"{named}\n{rows}", encoding="utf-8")
    columns = ", ".join(f'{name} = {{ name = "{own}" }}' for name, own in RENAMED.items())
    airframe = (here / "airframe.toml").read_text(encoding="utf-8")
    (here / "mapped.toml").write_text(
        f'{airframe}\n[[configuration]]\nmass = "unknown"\n'
        f'flights = [{{ file = "flight.csv", columns = {{ {columns} }} }}]\n',
        encoding="utf-8",
    )
    ended = run("inspect", "mapped.toml", "--airframe", "mapped.toml", "--json")
    assert (ended.code, ended.err) == (0, "")
    [report] = ended.json
    assert report["channels"][0]["source"] == "columns p, q, r [rad/s]"
    assert any(": identified: " in words for words in report["verdicts"]), report["trouble"]
    layout = ("--layout", "quad-x", "--order", "px4", "--spacing", "200,200", "-o", "seen.toml")
    seen = run("airframe", "mapped.toml", *layout)
    assert seen.code == 0, seen.err
    assert_wording(seen.out)


def test_an_airframe_file_next_to_a_log_is_its_airframe(run, here, judged):
    assert any(": identified: " in words for words in judged["verdicts"])
    assert run("inspect", "airframe.toml", "flight.csv", "--json").json == [judged]


def test_an_airframe_file_is_no_log(refused, here, assert_wording):
    words = refused("inspect", "airframe.toml")
    assert_wording(words)


def test_no_line_is_wider_than_the_terminal(run, changed, monkeypatch):
    changed(with_commands())
    monkeypatch.setenv("COLUMNS", "80")
    lines = run("inspect", "flight.csv").out.splitlines()
    assert max(map(len, lines)) <= 80
    assert max(map(len, lines)) > 70
    monkeypatch.setenv("COLUMNS", "200")
    assert 80 < max(map(len, run("inspect", "flight.csv").out.splitlines())) <= 100


def test_verdicts_stand_in_the_place_of_what_was_foreseen(run, here):
    text = run("inspect", "flight.csv", "--airframe", "airframe.toml").out
    assert "What this flight shows\n" in text
    assert "can be found" not in text


def test_what_cannot_be_identified_gets_no_advice_how(run, changed, assert_wording):
    only_commands = without("rotor_")
    advice = 'identify with speed = "commanded"'
    changed(only_commands)
    [flown] = run("inspect", "flight.csv", "--json").json
    assert any(advice in words for words in flown["trouble"])
    changed(lambda c: {n: v[:500] for n, v in only_commands(c).items()})
    [grounded] = run("inspect", "flight.csv", "--json").json
    assert any("only commands: log measured" in words for words in grounded["trouble"])
    assert not any(advice in words for words in grounded["trouble"])
    assert_wording(run("inspect", "flight.csv").out)


def test_a_motor_clock_that_is_far_off_is_named(run, changed, assert_wording):
    changed(lambda c: {n: np.roll(v, -40) if n.startswith("rotor") else v for n, v in c.items()})
    [report] = run("inspect", "flight.csv", "--json").json
    assert report["motor_lateness"] == pytest.approx(0.204, abs=0.004)
    text = " ".join(run("inspect", "flight.csv").out.split())
    assert "responds 204 ms" in text
    assert_wording(text)


def test_settings_are_those_of_the_firmware_and_of_a_file(run, here, blackbox):
    inav = re.sub(
        rb"H Firmware revision:[^\n]*", b"H Firmware revision:INAV 7.1.2 (abc) F7", blackbox
    )
    (here / "inav.bbl").write_bytes(inav)
    out = " ".join(run("inspect", "inav.bbl").out.split())
    assert "dshot_bidir" not in out and "blackbox_disable" not in out


def test_poses_at_times_of_receipt_are_not_sent_next_to_a_log(run, here, assert_wording):
    rng = np.random.default_rng(1)
    times = np.arange(400) * 0.01 + rng.exponential(0.008, 400)
    lines = [f"{t} {0.1 * i} 0 1 0 0 0 1" for i, t in enumerate(np.sort(times))]
    (here / "take.tum").write_text("\n".join(lines) + "\n", encoding="utf-8")
    [report] = run("inspect", "take.tum", "--json").json
    [words] = report["trouble"]
    assert_wording(words)
    assert "times of receipt" in words and "give it together" not in words


@pytest.mark.flights
def test_the_number_to_set_and_the_file_are_those_of_the_log(run, flight_data_dir, assert_wording):
    logs = sorted((flight_data_dir / "ardupilot-dronekit").glob("*.[bB][iI][nN]"))
    if not logs:
        pytest.skip("no DataFlash log")
    out = " ".join(run("inspect", logs[0]).out.split())
    assert out.count("LOG_BITMASK = 917503, which") == 2  # the reader's note, and the list
    assert f"settings {logs[0]}" in out
    assert_wording(out)
    assert "+LOG_BITMASK,917503" in run("settings", logs[0]).out
