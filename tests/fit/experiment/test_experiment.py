"""The experiment file: what is accepted, and what is refused in which words."""

import json
import re
from pathlib import Path

import pytest

from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.declared_vehicle import motor_model_of, read_options_of, vehicle_of
from rotorfit.fit.experiment.experiment import (
    MotorsEntry,
    load_experiment,
    single_flight_experiment,
)
from rotorfit.logs.motor_law import (
    MotorLaw,
    PolynomialCurve,
    PowerCurve,
    SquareRootCurve,
    TableCurve,
    VoltageFactor,
)

LAYOUT = 'layout = "quad-x"\narm = 0.2'
FLIGHT = 'mass = 1.2\nflights = ["a.csv"]'
THREE = (
    'rotors = [ { position = [0, -0.2, 0.01], spin = "ccw" },'
    ' { position = [0.2, 0.1, 0.01], spin = "cw" },'
    ' { position = [-0.2, 0.1, 0.01], spin = "cw", axis = [0.0, 0.3, 0.4], group = "rear" } ]'
)


def written(folder, *, airframe=LAYOUT, motors="", identification="", flights=FLIGHT, top=""):
    path = folder / "experiment.toml"
    path.write_text(
        f"{top}\n[airframe]\n{airframe}\n[motors]\n{motors}\n"
        f"[identification]\n{identification}\n[[configuration]]\n{flights}\n",
        encoding="utf-8",
    )
    return path


def refusal(path):
    with pytest.raises(ExperimentError) as caught:
        load_experiment(path)
    return str(caught.value)


def test_every_key_is_read(tmp_path):
    experiment = load_experiment(
        written(
            tmp_path,
            top='name = "two"',
            airframe=f'axes = "FLU"\n{THREE}\n'
            "imu = { position = [0.1, 0.2, 0.3], position_std = 0.1 }",
            motors='speed = "commanded"\nlaw = { polynomial = [0, 900, 50] }\nlag = 0.04\n'
            "delay = 0.01\npoles = 14",
            identification='source = "imu"\nmethod = "tls"\npreset = "paper"\ncutoff = 4\n'
            "r_sigma = 100",
            flights='name = "B"\nmass = 1.4\nmass_std = 0.002\nflights = [ "a.csv", '
            '{ file = "b.csv",'
            ' log = 2, start = 1, end = 9.5, axes = "FRD", columns = { gyro_x = "GX",'
            ' accel_x = { name = "AX", unit = "g", scale = 2, offset = 1,'
            " range = [-16, 16] } } } ]",
        )
    )
    assert experiment.name == "two"
    vehicle = vehicle_of(experiment.airframe)
    assert vehicle.imu_position == (0.1, 0.2, 0.3)
    assert vehicle.imu_position_std == 0.1
    assert vehicle.rotors[2].axis == pytest.approx((0.0, 0.6, 0.8))
    assert vehicle.rotors[2].group == "rear"
    motors = motor_model_of(experiment.motors)
    assert (motors.speed, motors.law) == (
        "commanded",
        MotorLaw(curve=PolynomialCurve((0.0, 900.0, 50.0))),
    )
    assert (motors.lag, motors.delay) == (0.04, 0.01)
    asked = experiment.identification
    assert (asked.method, asked.preset, asked.cutoff, asked.r_sigma) == ("tls", "paper", 4.0, 100.0)
    configuration = experiment.configuration[0]
    assert (configuration.name, configuration.mass_std) == ("B", 0.002)
    options = read_options_of(configuration.flights[1], experiment.motors)
    assert (options.log_number, options.axes, options.motor_poles) == (2, "FRD", 14)
    assert options.columns["gyro_x"].name == "GX"
    column = options.columns["accel_x"]
    assert (column.name, column.unit, column.scale, column.offset) == ("AX", "g", 2.0, 1.0)
    assert column.range == (-16.0, 16.0)
    assert (configuration.flights[1].start, configuration.flights[1].end) == (1.0, 9.5)


def test_defaults_are_the_plain_ones(tmp_path):
    experiment = load_experiment(written(tmp_path))
    assert experiment.name == "experiment"
    assert experiment.airframe.axes == "FLU"
    assert experiment.airframe.order == "px4"
    assert experiment.motors.speed == "measured"
    assert experiment.identification.method == "banded"
    assert experiment.configuration[0].name == "A"
    assert vehicle_of(experiment.airframe).imu_position is None


@pytest.mark.parametrize("mass", ["1.285", "2", '"unknown"'])
def test_mass_is_a_number_or_unknown(tmp_path, mass):
    loaded = load_experiment(written(tmp_path, flights=f'mass = {mass}\nflights = ["a"]'))
    assert repr(loaded.configuration[0].mass) in (mass, mass.replace('"', "'"), f"{mass}.0")


@pytest.mark.parametrize(
    ("mass", "words"),
    [
        ("mass = 0", "mass: should be greater than 0, or should be 'unknown' (it is 0)"),
        ("mass = -1.2", "mass: should be greater than 0"),
        ("mass = nan", "mass: should be a finite number"),
        ("mass = inf", "mass: should be a finite number"),
        ("mass = true", "mass: should be a valid number"),
        ('mass = "1.2"', "mass: should be a valid number"),
        ('mass = "heavy"', "should be 'unknown' (it is 'heavy')"),
        ("", "configuration[0].mass is missing"),
    ],
)
def test_a_wrong_mass_is_refused_once(tmp_path, mass, words):
    message = refusal(written(tmp_path, flights=f'{mass}\nflights = ["a.csv"]'))
    assert words in message
    assert message.count(";") == 0
    assert message.startswith("experiment.toml: ")


@pytest.mark.parametrize("masses", [("0.95", '"unknown"'), ('"unknown"', '"unknown"')])
def test_an_unknown_mass_stands_alone(tmp_path, masses, assert_wording):
    first, second = masses
    flights = (
        f'name = "A"\nmass = {first}\nflights = ["a.csv"]\n'
        f'[[configuration]]\nname = "B"\nmass = {second}\nflights = ["b.csv"]'
    )
    message = refusal(written(tmp_path, flights=flights))
    assert f"configuration '{'A' if first == second else 'B'}': mass = \"unknown\" among" in message
    assert_wording(message)
    assert message.count("\n") == 0


@pytest.mark.parametrize(
    ("part", "text", "words"),
    [
        ("top", 'nam = "x"', "unknown key nam, did you mean 'name'?"),
        ("airframe", f"{LAYOUT}\nimu = {{ posiion = [0, 0, 0] }}", "did you mean 'position'?"),
        ("airframe", f"{LAYOUT}\naxis = [0, 0, 1]", "unknown key airframe.axis, did you mean"),
        ("motors", 'sped = "measured"', "unknown key motors.sped, did you mean 'speed'?"),
        ("identification", "cutof = 3", "identification.cutof, did you mean 'cutoff'?"),
        ("flights", f"{FLIGHT}\nmas_std = 1", "configuration[0].mas_std, did you mean 'mass_std'?"),
        ("flights", f"{FLIGHT}\nqqqq = 1", "qqqq; known keys: airframe, arm, arm_std, axes"),
        (
            "flights",
            'mass = 1\nflights = [ { file = "a",'
            ' columns = { gyro_x = { name = "g", scal = 2 } } } ]',
            "unknown key configuration[0].flights[0].columns.gyro_x.scal, did you mean 'scale'?",
        ),
    ],
)
def test_unknown_keys_are_refused_with_the_nearest(tmp_path, part, text, words):
    assert words in refusal(written(tmp_path, **{part: text}))


def test_terms_are_those_of_the_model_each_once(tmp_path):
    text = 'terms = ["twist", "drag", "twist"]'
    asked = load_experiment(written(tmp_path, identification=text)).identification
    assert asked.terms == ("twist", "drag")
    assert load_experiment(written(tmp_path)).identification.terms is None


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ('method = "magic"', "should be 'banded', 'ols' or 'tls' (it is 'magic')"),
        ('preset = "papers"', "should be 'paper' (it is 'papers')"),
        ("cutoff = 0", "cutoff: should be greater than 0"),
        ('r_sigma = "x"', "r_sigma: should be a valid number"),
        (
            'terms = ["twits"]',
            "terms: no term 'twits', did you mean 'twist'? known terms: rotor_in",
        ),
        ('terms = ["qq"]', "terms: no term 'qq'; known terms: rotor_inertia, rotor_spread, accel"),
        ("terms = [1]", "terms: no term '1'; known terms: "),
        ('terms = "drag"', "terms: should be a list [ ... ] (it is 'drag')"),
        ('method = "ols"\nterms = ["drag"]', 'terms: they belong to method = "banded"; the other'),
        ('preset = "paper"\nterms = []', 'terms: they belong to method = "banded"; the other'),
    ],
)
def test_wrong_settings_are_refused(tmp_path, key, words):
    assert words in refusal(written(tmp_path, identification=key))


@pytest.mark.parametrize(
    ("airframe", "words"),
    [
        ("", "give either rotors = [ { position"),
        (f"{LAYOUT}\n{THREE}", "give either rotors = [ { position"),
        ('layout = "quad-x"', "layout needs either spacing"),
        ('layout = "quad-x"\narm = -0.2', "arm: should be greater than 0"),
        (
            'layout = "qad-x"\narm = 0.2',
            "no layout 'qad-x' in the motor order 'px4', did you mean 'quad-x'? known: quad-x",
        ),
        (
            'layout = "hexa-x"\narm = 1\norder = "betaflight"',
            "list the rotors as the log numbers them",
        ),
        (f'{LAYOUT}\norder = "pix4"', "should be 'px4', 'ardupilot', 'betaflight', 'crazyflie' or"),
        (
            f"{LAYOUT}\nmass = 0.4",
            "airframe.mass: mass belongs to another table: [[configuration]]",
        ),
        (f"{LAYOUT}\nlag = 0.02", "lag belongs to another table: write it under [motors]"),
        (f'{LAYOUT}\norder = "mine"', "(it is 'mine'). Of any other order, list the rotors"),
        (f'{LAYOUT}\naxes = "NED"', "axes: should be 'FLU' or 'FRD' (it is 'NED')"),
        (f"{LAYOUT}\nimu = {{ position = [0, 0] }}", "airframe.imu.position[2] is missing"),
        (f"{LAYOUT}\nimu = {{ position = [0, 0, nan] }}", "position[2]: should be a finite number"),
        (f"{LAYOUT}\nimu = {{ position = [0, 0, 2] }}", "the IMU is 2 m from the centre of the"),
        (f"{LAYOUT}\npropeller = 8", "(it is 8). It is the diameter in metres"),
        (
            f"{LAYOUT}\nimu = {{ position = [0, 0, 0], position_std = -1 }}",
            "should be greater than or equal to 0",
        ),
        ("rotors = []", "0 rotors; a multirotor has 3 to 16"),
        ('rotors = "four"', "airframe.rotors: should be a list [ ... ]"),
        ("rotors = [1, 2, 3]", "rotors[0]: should be a table { ... } (it is 1)"),
        (THREE.replace("cw", "CW"), "rotors[0].spin: should be 'ccw' or 'cw' (it is 'cCW')"),
        (f"{THREE}\narm = 0.2", "spacing and order belong to layout"),
        (f'{THREE}\norder = "px4"', "spacing and order belong to layout"),
        (THREE.replace("-0.2, 0.1", "0.2, 0.1"), "rotors 2 and 3 are both at [0.2, 0.1, 0.01]"),
    ],
)
def test_wrong_airframes_are_refused(tmp_path, airframe, words):
    assert words in refusal(written(tmp_path, airframe=airframe))


def test_a_rotor_without_direction_is_refused(tmp_path):
    rotors = THREE.replace("[0.0, 0.3, 0.4]", "[0, 0, 0]")
    with pytest.raises(ExperimentError, match="give the direction of its thrust"):
        vehicle_of(load_experiment(written(tmp_path, airframe=rotors)).airframe)


@pytest.mark.parametrize(
    ("motors", "words"),
    [
        ('speed = "guessed"', "should be 'measured' or 'commanded'"),
        ("lag = 0.04", "law and lag belong to speed = 'commanded'"),
        ("law = { polynomial = [0, 1] }", "law and lag belong to speed = 'commanded'"),
        ('speed = "commanded"\nlag = -1', "should be greater than or equal to 0"),
        ('speed = "commanded"\nlaw = { polynomial = [1] }', "polynomial: has too few entries"),
        ("delay = 0.5", "should be less than or equal to 0.1 (it is 0.5). It is in seconds"),
        ('speed = "commanded"\nlag = 40', "should be less than or equal to 1 (it is 40). It is in"),
        ("poles = 1", "should be greater than or equal to 2"),
    ],
)
def test_wrong_motors_are_refused(tmp_path, motors, words):
    assert words in refusal(written(tmp_path, motors=motors))


@pytest.mark.parametrize(
    ("flights", "words"),
    [
        ("", "flights is missing"),
        ("flights = []", "configuration[0].flights: has too few entries"),
        ('flights = "a.csv"', "flights: should be a list [ ... ] (it is 'a.csv')"),
        ("flights = [3]", "flights[0]: should be a table { ... } (it is 3)"),
        ('flights = [ { fil = "a" } ]', "configuration[0].flights[0].file is missing"),
        ('flights = [ { file = "a", log = 0 } ]', "should be greater than or equal to 1"),
        ('flights = [ { file = "a", start = 3, end = 3 } ]', "end = 3.0 is not after start = 3.0"),
        ('flights = [ { file = "a", axes = "NED" } ]', "should be 'FLU' or 'FRD'"),
        ('flights = [ "a", "b", { file = "a" } ]', "flight 'a' is listed twice"),
    ],
)
def test_wrong_flights_are_refused(tmp_path, flights, words):
    assert words in refusal(written(tmp_path, flights=f"mass = 1.0\n{flights}"))


def test_two_parts_of_one_log_are_two_flights(tmp_path):
    flights = 'flights = [ { file = "a", end = 9 }, { file = "a", start = 9 } ]'
    experiment = load_experiment(written(tmp_path, flights=f"mass = 1.0\n{flights}"))
    assert len(experiment.configuration[0].flights) == 2


def test_several_problems_are_all_named(tmp_path):
    message = refusal(written(tmp_path, motors="poles = 1", flights="mass = 0\nflights = []"))
    for place in ("motors.poles", "configuration[0].mass", "configuration[0].flights"):
        assert place in message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[airframe", "is not valid TOML: "),
        (b"\xff\xfe\x00", "is not text in UTF-8, as TOML is"),
        (b"", "airframe is missing; configuration is missing"),
        (b"\xef\xbb\xbfname = 3", 'name: should be text in "quotes"'),
    ],
)
def test_files_that_are_no_experiment_are_refused(tmp_path, content, words):
    path = tmp_path / "experiment.toml"
    path.write_bytes(content)
    assert words in refusal(path)


def test_missing_files_and_folders_are_refused(tmp_path, assert_wording):
    assert refusal(tmp_path / "none.toml").startswith("no file ")
    assert_wording(refusal(tmp_path))


def test_flights_are_relative_to_the_file(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    absolute = (tmp_path / "b.csv").as_posix()
    flights = f'mass = 1.0\nflights = [ "logs/a.csv", "{absolute}" ]'
    path = written(tmp_path, flights=flights)
    for given in (path, Path("..") / "experiment.toml"):
        loaded = load_experiment(given).configuration[0].flights
        assert Path(loaded[0].file).is_absolute()
        assert Path(loaded[0].file).resolve() == (tmp_path / "logs" / "a.csv").resolve()
        assert Path(loaded[1].file) == tmp_path / "b.csv"
        assert [flight.written for flight in loaded] == ["logs/a.csv", absolute]


def mirrored(match):
    x, y, z = (float(part) for part in match[1].split(","))
    return f"[{x}, {-y}, {-z}]"


def test_an_frd_airframe_equals_its_flu_twin(tmp_path):
    body = f"{THREE}\nimu = {{ position = [0.01, 0.02, 0.03] }}"
    flu = load_experiment(written(tmp_path, airframe=body)).airframe
    turned = re.sub(r"\[([-0-9., ]+)\]", mirrored, body)
    assert turned != body
    frd = load_experiment(written(tmp_path, airframe=f'axes = "FRD"\n{turned}')).airframe
    assert vehicle_of(frd) == vehicle_of(flu)
    assert vehicle_of(frd).rotors[0].axis == (0.0, 0.0, 1.0)


def test_one_log_needs_a_mass_and_an_airframe_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    airframe = tmp_path / "airframe.toml"
    airframe.write_text(f"[airframe]\n{LAYOUT}\n[motors]\npoles = 14\n")
    made = single_flight_experiment(Path("LOG7.BFL"), mass=0.5, airframe=airframe)
    assert made.name == "LOG7"
    (flight,) = made.configuration[0].flights
    assert (Path(flight.file), flight.written) == (tmp_path / "LOG7.BFL", "LOG7.BFL")
    assert made.motors.poles == 14
    for mass in (0.0, -1.0, float("nan")):
        with pytest.raises(ExperimentError, match=r"airframe.toml: configuration\[0\].mass"):
            single_flight_experiment(Path("a"), mass=mass, airframe=airframe)
    airframe.write_text(f"name = 'mine'\n[airframe]\n{LAYOUT}\n")
    with pytest.raises(ExperimentError, match="name belongs in an experiment file"):
        single_flight_experiment(Path("a"), mass=0.5, airframe=airframe)


def test_a_table_of_experiments_in_an_airframe_file_is_said(tmp_path):
    path = tmp_path / "airframe.toml"
    path.write_text(f"[airframe]\n{LAYOUT}\n[identification]\nmethod = 'ols'\n")
    with pytest.raises(ExperimentError, match="identification belongs in an experiment file"):
        single_flight_experiment(tmp_path / "log.csv", mass=1.0, airframe=path)


def test_an_experiment_file_is_an_airframe_file(tmp_path):
    whole = written(tmp_path, motors="poles = 14", identification='method = "tls"')
    made = single_flight_experiment(tmp_path / "other.csv", mass=0.5, airframe=whole)
    assert made.airframe == load_experiment(whole).airframe
    assert (made.motors.poles, made.identification.method) == (14, "banded")
    assert [Path(f.file).name for f in made.configuration[0].flights] == ["other.csv"]


@pytest.mark.parametrize(
    ("law", "curve"),
    [
        ("linear = [380, 2671.6]", PolynomialCurve((380.0, 2671.6))),
        ("polynomial = [0, 900, 50]", PolynomialCurve((0.0, 900.0, 50.0))),
        (
            "table = [[0.1, 0], [0.5, 400.5], [1, 900]]",
            TableCurve((0.1, 0.5, 1.0), (0.0, 400.5, 900.0)),
        ),
        ("sqrt = { full_speed = 900, thr_mdl_fac = 0.3 }", SquareRootCurve(900.0, 0.3)),
        ("power = { full_speed = 900, exponent = 0.7 }", PowerCurve(900.0, 0.0, 0.7)),
        (
            "power = { full_speed = 900, offset = 0.1, exponent = 0.7 }",
            PowerCurve(900.0, 0.1, 0.7),
        ),
    ],
)
def test_every_law_of_the_motors_is_read(tmp_path, law, curve):
    motors = f'speed = "commanded"\nlaw = {{ {law} }}'
    loaded = load_experiment(written(tmp_path, motors=motors))
    assert motor_model_of(loaded.motors).law == MotorLaw(curve=curve)
    motors = f'speed = "commanded"\nlaw = {{ {law}, voltage = {{ nominal = 4.2 }} }}'
    loaded = load_experiment(written(tmp_path, motors=motors))
    expected = MotorLaw(curve=curve, voltage=VoltageFactor(4.2, 1.0))
    assert motor_model_of(loaded.motors).law == expected
    saved = loaded.motors.model_dump(mode="json")
    assert next(iter(saved["law"])) == law.partition(" ")[0]
    assert MotorsEntry.model_validate(saved).law == expected


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("", "motors.law: give exactly one of linear = [offset, slope]"),
        ("", "none is given"),
        ("linear = [0, 1], polynomial = [0, 1]", "linear and polynomial are given"),
        ("linear = [0]", "law.linear[1] is missing"),
        ("linear = [10, -5]", "law.linear[1]: should be greater than 0 (it is -5)"),
        ("table = [[0, 1]]", "law.table: has too few entries"),
        ("table = [[0, 0], [1.2, 9]]", "law.table[1][0]: should be less than or equal to 1"),
        ("table = [[0, 0], [1, -9]]", "law.table[1][1]: should be greater than or equal to 0"),
        (
            "table = [[0, 0], [0.5, 9], [0.5, 10]]",
            "table goes from [0.5, 9] to [0.5, 10]; command and speed must both rise",
        ),
        ("table = [[0, 5], [0.5, 5]]", "table goes from [0, 5] to [0.5, 5]"),
        ("sqrt = { full_speed = 900 }", "law.sqrt.thr_mdl_fac is missing"),
        ("sqrt = { full_speed = 0, thr_mdl_fac = 0.3 }", "full_speed: should be greater than 0"),
        ("sqrt = { full_speed = 9, thr_mdl_fac = 1.3 }", "should be less than or equal to 1"),
        ("sqrt = { full_sped = 9, thr_mdl_fac = 1 }", "full_sped, did you mean 'full_speed'?"),
        ("linear = [0, 1], voltage = { nominal = 0 }", "nominal: should be greater than 0"),
        (
            "linear = [0, 1], voltage = { nominal = 4, exponent = 0 }",
            "exponent: should be greater than 0",
        ),
        ("power = { full_speed = 900 }", "law.power.exponent is missing"),
        ("power = { full_speed = 9, offset = 1, exponent = 1 }", "should be less than 1"),
        ("linear = [0, nan]", "should be a finite number"),
    ],
)
def test_wrong_laws_are_refused(tmp_path, law, words):
    motors = f'speed = "commanded"\nlaw = {{ {law} }}'
    assert words in refusal(written(tmp_path, motors=motors))


KNOWN = {
    "speed": "commanded",
    "law": {"power": {"full_speed": 4400.0, "offset": 0.05, "exponent": 0.74}},
    "lag": 0.023,
    "lag_std": 0.001,
}


def with_result(folder, found, motors='result = "known.json"'):
    (folder / "known.json").write_text(json.dumps({"command_law": found}), encoding="utf-8")
    return written(folder, motors=motors)


def test_law_and_lag_are_taken_from_a_result(tmp_path):
    motors = load_experiment(with_result(tmp_path, {"motors": KNOWN})).motors
    assert motors.speed == "commanded"
    assert motor_model_of(motors).law == MotorLaw(curve=PowerCurve(4400.0, 0.05, 0.74))
    assert (motors.lag, motors.lag_std) == (0.023, 0.001)


def test_what_stands_next_to_a_result_goes_before(tmp_path):
    beside = 'result = "known.json"\nlag = 0.03\ndelay = 0.002'
    motors = load_experiment(with_result(tmp_path, {"motors": KNOWN}, beside)).motors
    assert (motors.lag, motors.lag_std, motors.delay) == (0.03, 0.0, 0.002)


def test_an_airframe_file_takes_a_result_too(tmp_path):
    with_result(tmp_path, {"motors": KNOWN})
    airframe = tmp_path / "airframe.toml"
    airframe.write_text(
        f'[airframe]\n{LAYOUT}\n[motors]\nresult = "known.json"\n', encoding="utf-8"
    )
    one = single_flight_experiment(Path("a.csv"), mass=1.0, airframe=airframe)
    assert one.motors.lag == 0.023


@pytest.mark.parametrize(
    ("found", "motors", "words"),
    [
        (None, 'result = "known.json"', "known.json has no law from command to rotor speed"),
        ({"motors": {}}, 'result = "known.json"', "known.json has no law"),
        ({"motors": KNOWN}, 'result = "other.json"', "other.json is not a result with the motors"),
        ([], 'result = "known.json"', "is not a result with the motors' law"),
        ({"motors": KNOWN}, "result = 3", "motors.result is 3, expected the path"),
        (
            {"motors": KNOWN},
            'speed = "measured"\nresult = "known.json"',
            'motors.result gives law and lag for flights on commands: speed = "commanded"',
        ),
        ({"motors": {**KNOWN, "lag": -1}}, 'result = "known.json"', "motors.lag: should be"),
    ],
)
def test_results_without_a_law_are_refused(tmp_path, found, motors, words):
    assert words in refusal(with_result(tmp_path, found, motors))
