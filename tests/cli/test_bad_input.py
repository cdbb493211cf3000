"""Whatever is wrong, the command line says in one line what, and what to do; exit code 1."""

import random
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import without

LOG = ("flight.csv", "--mass", "1.285", "--airframe", "airframe.toml")


def masked(line: str, here: Path) -> str:
    """Return a message without what differs: the folder, measured numbers, formats read so far."""
    line = re.sub(r"rotorfit reads .*", "rotorfit reads ...", line.replace(str(here), "HERE"))
    return re.sub(r"[-+]?\d+\.\d+(e[-+]\d+)?|\d{3,}", "#", line)


@pytest.fixture
def message(refused, here, golden, request):
    """Refuse, compare the message with its golden file, and return it."""

    def compared(*arguments: object) -> str:
        line = refused(*arguments)
        name = re.sub(r"\W+", "_", request.node.name.removeprefix("test_")).strip("_")
        assert masked(line, here) == golden(f"errors/{name}.txt", masked(line, here))
        return line

    return compared


# -- the file ------------------------------------------------------------------------------------


def test_missing_log(message):
    assert "none.csv: no such file" in message("identify", "none.csv", *LOG[1:])


def test_an_address(message):
    assert "download" in message("inspect", "https://logs.px4.io/plot_app?log=1")


def test_missing_experiment(message):
    assert "none.toml" in message("identify", "none.toml")


def test_missing_airframe(message):
    assert "none.toml" in message("identify", *LOG[:-1], "none.toml")


def test_missing_flight_of_an_experiment(message, here):
    (here / "flight.csv").unlink()
    assert "flight.csv: no such file" in message("identify", "experiment.toml")


def test_an_airframe_in_place_of_a_log(message):
    line = message("identify", "airframe.toml", "--mass", "1")
    assert "--airframe airframe.toml" in line


def test_a_directory(message, here):
    (here / "folder.csv").mkdir()
    assert "is a directory" in message("identify", "folder.csv", *LOG[1:])


def test_a_directory_for_an_experiment(message, here):
    (here / "folder.toml").mkdir()
    assert "is a folder" in message("identify", "folder.toml")


def test_an_empty_file(message, here):
    (here / "flight.csv").write_bytes(b"")
    assert "is empty" in message("identify", *LOG)


def test_an_unreadable_file(message, here, monkeypatch):
    plain = Path.open

    def denied(self, *arguments, **options):
        if self.name == "flight.csv":
            raise PermissionError(13, "Permission denied", str(self))
        return plain(self, *arguments, **options)

    monkeypatch.setattr(Path, "open", denied)
    assert "permission denied" in message("identify", *LOG)


FORMATS = {
    "pdf": (b"%PDF-1.7\n%\xe2\xe3", "a PDF document"),
    "png": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "an image"),
    "json": (b'{"gyro": [1, 2, 3]}', "JSON"),
    "zip": (b"PK\x03\x04\x14\0\0\0", "a damaged archive"),
    "noise": (random.Random(4).randbytes(4000), "unknown format"),
    "cut-off-gzip": (b"\x1f\x8b\x08\0\0", "a damaged archive"),
}


@pytest.mark.parametrize("kind", FORMATS)
def test_another_format(message, here, kind):
    content, words = FORMATS[kind]
    (here / "flight.csv").write_bytes(content)
    assert words in message("identify", *LOG)


def test_a_broken_ulog(refused, here):
    (here / "flight.csv").write_bytes(b"ULog\x01\x12\x35\x01" + bytes(100))
    assert "flight.csv" in refused("identify", *LOG)


def test_text_that_is_no_table(message, here, assert_wording):
    (here / "flight.csv").write_text("Dear pilot,\nthe battery is charged.\n")
    assert_wording(message("identify", *LOG))


# -- what the log holds --------------------------------------------------------------------------


def test_all_nan(message, changed):
    changed(lambda c: {name: c[name] if name == "time" else c[name] * np.nan for name in c})
    assert "holds no number" in message("identify", *LOG)


def test_one_sample(message, changed):
    changed(lambda c: {name: values[:1] for name, values in c.items()})
    assert "one sample only" in message("identify", *LOG)


def test_names_without_rows(message, changed):
    changed(lambda c: {name: values[:0] for name, values in c.items()})
    assert "nothing was recorded" in message("identify", *LOG)


def test_no_motors(message, changed):
    changed(without("rotor_", "command_"))
    assert "no motor data" in message("identify", *LOG)


def test_only_commands(message, changed):
    changed(without("rotor_"))
    assert 'speed = "commanded"' in message("identify", *LOG)


def test_no_gyro(message, changed):
    changed(without("gyro"))
    assert "no rotation rates" in message("identify", *LOG)


def test_no_accelerometer(message, changed):
    changed(without("accel"))
    assert "no specific force" in message("identify", *LOG)


def test_another_number_of_rotors(message, here):
    text = (here / "airframe.toml").read_text()
    (here / "airframe.toml").write_text(text.replace("quad-plus", "hexa-x").replace("paper", "px4"))
    assert "4 motors" in message("identify", *LOG)


def test_motors_that_never_turn(message, changed, assert_wording):
    still = ("rotor", "command")
    changed(lambda c: {n: 0.0 * v if n.startswith(still) else v for n, v in c.items()})
    assert_wording(message("identify", *LOG))


def test_speeds_that_never_leave_zero_beside_commands(message, changed, assert_wording):
    changed(lambda c: {n: 0.0 * v if n.startswith("rotor") else v for n, v in c.items()})
    assert_wording(message("identify", *LOG))


def test_time_that_goes_backwards(message, changed):
    def swap(c):
        c["time"][1000:2000] -= 3.0
        return c

    changed(lambda c: swap({n: v.copy() for n, v in c.items()}))
    assert "time goes back" in message("identify", *LOG)


def test_a_constant_gyro(message, changed):
    changed(lambda c: {n: 0.0 * v + 0.1 if n.startswith("gyro") else v for n, v in c.items()})
    assert "constant" in message("identify", *LOG)


def test_gyro_in_degrees(message, changed):
    changed(lambda c: {n: np.degrees(v) if n.startswith("gyro") else v for n, v in c.items()})
    assert "deg/s" in message("identify", *LOG)


def test_accelerometer_in_g(message, changed):
    changed(lambda c: {n: v / 9.80665 if n.startswith("accel") else v for n, v in c.items()})
    assert "units of g" in message("identify", *LOG)


def test_never_airborne(message, changed, assert_wording):
    # The first three seconds stand on the ground.
    changed(lambda c: {n: v[:500] for n, v in c.items()})
    assert_wording(message("identify", *LOG))


# -- what is declared ----------------------------------------------------------------------------


def test_frd_table_declared_flu(message, changed):
    turned = ("gyro_y", "gyro_z", "accel_y", "accel_z")
    changed(lambda c: {n: -v if n in turned else v for n, v in c.items()})
    assert 'axes = "FRD"' in message("identify", *LOG)


def test_swapped_motors(message, changed):
    other = {"rotor_1": "rotor_3", "rotor_3": "rotor_1"}
    changed(lambda c: {n: c[other.get(n, n)] for n in c})
    assert "order" in message("identify", *LOG)


def test_reversed_spins(message, here):
    rotors = ", ".join(
        f'{{ position = {place}, spin = "{spin}" }}'
        for place, spin in (
            ([0.0, -0.2, 0.0], "cw"),
            ([0.0, 0.2, 0.0], "cw"),
            ([0.2, 0.0, 0.0], "ccw"),
            ([-0.2, 0.0, 0.0], "ccw"),
        )
    )
    (here / "airframe.toml").write_text(f"[airframe]\nrotors = [{rotors}]\n")
    assert "every spin reversed" in message("identify", *LOG)


@pytest.mark.parametrize("mass", ["0", "-1", "nan", "inf", "-inf", "0.0"])
def test_a_mass_that_is_none(refused, here, mass):
    line = refused("identify", "flight.csv", "--mass", mass, "--airframe", "airframe.toml")
    assert f"--mass is {mass}, expected more than 0 kg" in line


@pytest.mark.parametrize("mass", ["0", "-1", "nan", "inf", '"heavy"', "true", "[1.0]"])
def test_a_mass_that_is_none_in_a_file(refused, here, mass):
    text = (here / "experiment.toml").read_text()
    (here / "experiment.toml").write_text(text.replace("1.285", mass))
    assert "configuration[0].mass" in refused("identify", "experiment.toml")


def test_a_window_outside_the_log(message):
    assert "no usable samples" in message("identify", *LOG, "--start", "500")


def test_a_window_backwards(message):
    assert "not before" in message("identify", *LOG, "--start", "9", "--end", "7")


def test_a_log_that_the_file_does_not_have(message):
    assert "no log 2" in message("identify", *LOG, "--log", "2")


# -- the experiment file -------------------------------------------------------------------------


def experiment(here: Path, change) -> str:
    path = here / "experiment.toml"
    path.write_text(change(path.read_text()))
    return path.name


def test_an_unknown_key(message, here):
    line = message("identify", experiment(here, lambda text: text.replace("mass =", "mas =")))
    assert "did you mean 'mass'" in line


def test_no_mass_in_the_file(message, here):
    line = message("identify", experiment(here, lambda text: text.replace("mass = 1.285", "")))
    assert "mass is missing" in line


def test_no_configuration(message, here, assert_wording):
    name = experiment(here, lambda text: text.split("[[configuration]]")[0])
    assert_wording(message("identify", name))


def test_two_configurations_by_rows(message, here):
    second = '[[configuration]]\nname = "B"\nmass = 1.4\nflights = ["flight.csv"]\n'
    name = experiment(here, lambda text: text + second)
    assert "takes one configuration" in message("identify", name, "--method", "ols")


def test_no_toml(message, here):
    assert "not valid TOML" in message("identify", experiment(here, lambda text: text + "= = ="))


def test_binary_garbage(message, here):
    (here / "experiment.toml").write_bytes(b"\xff\xfe\0\x80garbage\xff")
    assert "is not text in UTF-8" in message("identify", "experiment.toml")


# -- the output ----------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [("-o", "there.json"), ("--json", "-o", "there.json")])
def test_output_that_exists(refused, here, options):
    (here / "there.json").write_text("mine")
    assert "pass --force" in refused("identify", "experiment.toml", *options)
    assert (here / "there.json").read_text() == "mine"


def test_output_in_no_folder(message):
    assert "there is no folder none" in message("identify", *LOG, "-o", "none/result.json")


def test_output_that_is_a_folder(message, here):
    (here / "folder").mkdir()
    assert "is a folder" in message("identify", *LOG, "-o", "folder", "--force")


@pytest.mark.parametrize("name", ["flight.csv", "airframe.toml"])
def test_output_over_an_input(refused, here, name):
    before = (here / name).read_bytes()
    line = refused("identify", *LOG, "-o", f"./{name}", "--force")
    assert "is an input" in line
    assert (here / name).read_bytes() == before


def test_demo_into_a_folder_with_results(message, here):
    (here / "demo").mkdir()
    (here / "demo" / "result.json").write_text("mine")
    assert "already holds result.json" in message("demo", "-o", "demo")


def test_demo_into_a_file(refused, here):
    assert "cannot be made a folder" in refused("demo", "-o", "flight.csv")


# -- wrong usage ---------------------------------------------------------------------------------

USAGE = {
    "no mass": ("identify", "flight.csv", "--airframe", "airframe.toml"),
    "no airframe": ("identify", "flight.csv", "--mass", "1"),
    "neither": ("identify", "flight.csv"),
    "mass in words": ("identify", "flight.csv", "--mass", "abc", "--airframe", "airframe.toml"),
    "mass beside an experiment": ("identify", "experiment.toml", "--mass", "1"),
    "log beside an experiment": ("identify", "experiment.toml", "--log", "1"),
    "start beside an experiment": ("identify", "experiment.toml", "--start", "1"),
    "negative start": ("identify", *LOG, "--start", "-1"),
    "unknown method": ("identify", "experiment.toml", "--method", "magic"),
    "unknown option": ("identify", "experiment.toml", "--fast"),
    "unknown command": ("identfy", "experiment.toml"),
    "no file": ("identify",),
    "log 0": ("inspect", "flight.csv", "--log", "0"),
    "nothing to inspect": ("inspect",),
    "seed below zero": ("demo", "--seed", "-1"),
}


@pytest.mark.parametrize("case", USAGE)
def test_wrong_usage(run, here, case):
    before = sorted(here.rglob("*"))
    ended = run(*USAGE[case])
    assert (ended.code, ended.out) == (2, "")
    assert "Error: " in ended.err and "Traceback" not in ended.err
    assert sorted(here.rglob("*")) == before
