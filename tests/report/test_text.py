"""The text of a result: one screen, honest digits, every verdict, no advice twice."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from rotorfit.digits import with_interval
from rotorfit.findings import doubt
from rotorfit.report.parameters import axis_of
from rotorfit.report.text import result_text
from rotorfit.results.result import (
    Derived,
    FlightRecord,
    IdentificationResult,
    Parameter,
)

SCALE = "a measured Izz would"
ROLL = "roll briskly"
BODY = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
COM = ("com_x", "com_y", "com_z", *(f"{name}_com" for name in BODY[3:]))

# -- numbers -------------------------------------------------------------------------------------

SHOWN = re.compile(r"\(?(-?\d+(?:\.\d+)?) \+- (\d+(?:\.\d+)?)\)?(?:e([+-]\d\d))?")
sizes = st.floats(min_value=1e-30, max_value=1e30)


@given(value=sizes | sizes.map(lambda x: -x) | st.just(0.0), relative=st.floats(1e-6, 1e6))
@example(value=0.0, relative=1.0)
@example(value=9.9996, relative=1e-4)
@example(value=99999.96, relative=1e-3)
def test_the_shown_digits_hold_the_value(value, relative):
    half = relative * (abs(value) or 1.0)
    low, high = value - half, value + half
    half = 0.5 * (high - low)
    assume(half > 0)
    text = with_interval(value, (low, high))
    found = SHOWN.fullmatch(text)
    assert found, text
    shown, shown_half, power = found.groups()
    scale = 10.0 ** int(power or 0)
    # Half a unit of the second digit of the half-width as shown, and a little for rounding itself.
    unit = 10.0 ** (math.floor(math.log10(float(f"{half:.1e}")) + 1e-12) - 1)
    rounding = 1e-12 * abs(value)
    assert abs(float(shown) * scale - value) <= 0.5001 * unit + rounding, text
    assert abs(float(shown_half) * scale - half) <= 0.5001 * unit + rounding, text
    digits = shown.lstrip("-").split(".")[0]
    assert len(digits) <= 7 and not re.match(r"-0(\.0+)?$", shown), text


odd = st.sampled_from([math.nan, math.inf, -math.inf, 0.0])
numbers = sizes | sizes.map(lambda x: -x) | odd


@given(value=numbers, low=numbers, high=numbers)
def test_never_nan_nor_minus_zero(value, low, high):
    text = with_interval(value, (min(low, high), max(low, high)))
    assert not re.search(r"nan|inf|-0(\.0*)?(?![\d.])", text)
    assert (text == "-") == (not math.isfinite(value))


def test_numbers_as_they_are_read():
    assert with_interval(2.656e-7, (2.604e-7, 2.708e-7)) == "(2.656 +- 0.052)e-07"
    assert with_interval(0.01834, (0.01784, 0.01884)) == "0.01834 +- 0.00050"
    assert with_interval(930.6, (924.8, 936.4)) == "930.6 +- 5.8"
    assert with_interval(2.591, (2.4914, 2.6906)) == "2.59 +- 0.10"
    assert with_interval(18536.0, (16753.0, 20319.0)) == "18500 +- 1800"
    assert with_interval(1.285, None) == "1.285"
    assert with_interval(0.0, None) == "0"
    assert with_interval(None, None) == "-"
    assert with_interval(2.0, (1.8, 3.0)) == "2.00 (1.80 to 3.00)"
    assert with_interval(2e-7, (1.8e-7, 3e-7)) == "(2.00 (1.80 to 3.00))e-07"


# -- the screen ----------------------------------------------------------------------------------


def parameter(name: str, verdict: str = "identified", **changes) -> Parameter:
    shared = name in ("kt", "kd", "Jr", "motor_delay") or name.startswith("kt_")
    known = verdict in ("identified", "weak", "given")
    fields = {
        "name": name,
        "configuration": None if shared else "A",
        "value": 1.25e-2 if known else None,
        "std": 1e-4 if known and verdict != "given" else None,
        "interval": (1.23e-2, 1.27e-2) if known and verdict != "given" else None,
        "unit": "kg m^2",
        "verdict": verdict,
    }
    return Parameter(**(fields | changes))


def derived(name: str, value: float | None = 0.5) -> Derived:
    interval = None if value is None else (0.9 * value, 1.1 * value)
    std = None if value is None else 0.05 * value
    return Derived(
        name=name, configuration="A", value=value, std=std, interval=interval, unit="kg m^2"
    )


def result_of(
    parameters: list[Parameter],
    numbers: Sequence[Derived] = (),
    **changes,
) -> IdentificationResult:
    record = FlightRecord(
        file="C:\\logs\\a.csv",
        sha256="0" * 64,
        configuration="A",
        seconds_used=20.0,
        samples_used=4000,
        used=((1.0, 21.0),),
        cuts=(),
        findings=(doubt("gyro-bias", "no 1 s at rest found"),),
    )
    fields = {
        "name": "test",
        "method": "banded",
        "parameters": tuple(parameters),
        "derived": tuple(numbers),
        "flights": (record,),
        "covariance_names": (),
        "covariance": np.zeros((0, 0)),
        "settings": {},
        "versions": {},
    }
    return IdentificationResult(**(fields | changes))


def sample() -> IdentificationResult:
    """A result of a quadrotor with everything that can be the matter."""
    ratio = {"reason": "the yaw equation gives only ratios", "advice": SCALE}
    lost = {"reason": "the interval is wider than the value", "advice": ROLL}
    parameters = [
        *(parameter(name) for name in ("kt", "kt_1", "kt_2", "kt_3", "kt_4", "motor_delay")),
        *(parameter(name, "ratio-only", partner="Izz", **ratio) for name in ("kd", "Jr")),
        parameter("mass", "given"),
        *(parameter(name) for name in ("msx", "msy", "Ixx", "Iyy", "Ixy")),
        parameter("msz", "removed", reason="largest deviation"),
        parameter("Ixz", "weak", reason="known only to +-60 %", advice=ROLL),
        parameter("Iyz", "not-identified", **lost),
        parameter("Izz", "ratio-only", partner="kd", **ratio),
        *(parameter(f"accel_bias_{axis}") for axis in "xyz"),
        *(parameter(f"rotor_center_{axis}", "not-identified", **lost) for axis in "xy"),
    ]
    gone = ("com_z", "Izz_com", "Iyz_com")
    numbers = [derived(name, None if name in gone else 0.5) for name in COM]
    wide = {"Ixz_com": (0.2, 0.8)}
    numbers = [replace(n, interval=wide.get(n.name, n.interval)) for n in numbers]
    numbers += [derived(name) for name in ("kd_over_Izz", "Jr_over_Izz", "hover_speed")]
    rolls = f"roll: the rotors explain little; {ROLL}"
    doubts = tuple(doubt("made", words) for words in (rolls, rolls, "a doubt " * 40))
    return result_of(parameters, numbers, findings=doubts)


def rows(text: str) -> dict[str, str]:
    """Return the lines of the tables by the name that they begin with."""
    lines = [line for line in text.splitlines() if re.match(r"  \w", line)]
    return {line.split()[0]: line for line in lines}


def body_with(twin: Parameter, half: float, value: float = 0.5, moment: float | None = 0.5) -> str:
    """Return the text of a body with one product of inertia of this half-width."""
    about = [derived(f"{name}_com", moment) for name in ("Ixx", "Iyy", "Izz")]
    product = replace(derived("Ixz_com", value), interval=(value - half, value + half))
    others = [parameter(name) for name in ("Ixx", "Iyy", "Izz")]
    return result_text(result_of([*others, twin], [*about, product]))


def test_a_sharp_number_is_not_weak_for_its_twin_at_the_origin():
    text = body_with(parameter("Ixz", "weak", reason="known only to +-60 %", advice=ROLL), 0.05)
    assert rows(text)["Ixz_com"].endswith(" identified")
    assert "Ixz_com (" not in text and "weak:" not in text


def test_a_shown_number_is_not_called_wider_than_its_value():
    lost = parameter("Ixz", "not-identified", reason="the interval is wider", advice=ROLL)
    text = body_with(lost, 0.2)
    assert rows(text)["Ixz_com"].endswith(" weak")
    assert "wider" not in text and "Ixz_com (weak): " in text


def test_a_wide_number_is_weak_with_a_sharp_twin_at_the_origin():
    text = body_with(parameter("Ixz"), 0.2)
    assert rows(text)["Ixz_com"].endswith(" weak")
    assert "Ixz_com (weak): roll briskly" in text


def test_a_product_near_zero_goes_by_the_moments():
    text = body_with(parameter("Ixz"), 0.006, value=0.001)  # a twentieth of 0.5: 24 %
    assert rows(text)["Ixz_com"].endswith(" identified")
    text = body_with(parameter("Ixz", "weak", advice=ROLL), 0.006, value=0.001, moment=None)
    assert rows(text)["Ixz_com"].endswith(" weak")


def test_one_screen():
    lines = result_text(sample()).splitlines()
    assert len(lines) <= 52
    assert max(map(len, lines)) <= 100
    assert "None" not in "\n".join(lines) and "nan" not in "\n".join(lines)


def test_a_narrow_terminal_gets_columns_below_one_another():
    wide, narrow = result_text(sample()), result_text(sample(), width=60)
    assert max(map(len, narrow.splitlines())) <= 60 < max(map(len, wide.splitlines()))
    assert narrow.split() == wide.split()
    row = next(line for line in wide.splitlines() if line.startswith("  kd "))
    first, second = re.search(r"\n(  kd .*)\n( {8}\S.*)\n", narrow).groups()
    assert [*first.split(), *second.split()] == row.split()


def test_a_long_unit_leaves_the_verdict_on_the_line():
    coefficient = parameter("kt_1", "not-identified", unit="N per squared command")
    [row] = [x for x in result_text(result_of([coefficient])).splitlines() if x[2:6] == "kt_1"]
    assert row.split() == ["kt_1", "-", "N", "per", "squared", "command", "not-identified"]


def test_word_by_word(golden):
    text = result_text(sample())
    assert text == golden("report/text.txt", text)


def test_every_verdict_is_shown_next_to_its_number():
    result = sample()
    shown = rows(result_text(result))
    about_com = dict(zip(BODY, COM, strict=True))
    for p in result.parameters:
        line = shown[about_com.get(p.name, p.name)]
        partner = f" with {p.partner}" if p.partner else ""
        assert line.endswith(f" {p.verdict}{partner}"), line
        if p.name not in about_com:
            assert f" {with_interval(p.value, p.interval)} " in line


def test_the_paper_s_numbers_have_no_twin_about_the_com():
    result = result_of([parameter(name) for name in ("kt", "mass", *BODY)])
    shown = rows(result_text(result))
    assert list(shown) == ["kt", "mass", *BODY]


def test_text_and_json_agree(tmp_path):
    result = sample()
    result.save(tmp_path / "result.json")
    loaded = IdentificationResult.load(tmp_path / "result.json")
    assert result_text(loaded) == result_text(result)


def test_advice_is_given_once_with_the_numbers_it_is_for(assert_wording):
    text, _, step = " ".join(result_text(sample()).split()).partition("Next step: ")
    assert step == SCALE  # and one of them is the next step, as everywhere
    assert text.count(SCALE) == 1
    assert text.count(ROLL) == 1
    assert f"ratios): {SCALE}" in text
    assert_wording(text)
    wider = "Iyz_com, rotor_center_x, rotor_center_y (the interval is wider than the value)"
    assert f"Ixz_com (weak); {wider}: {ROLL}" in text
    assert text.count("the rotors explain little") == 1


def test_words_are_explained_where_they_occur(assert_text):
    text = result_text(sample())
    assert_text(text.splitlines()[0])
    assert text.count("95 %") == 1
    for verdict in ("weak", "ratio-only", "not-identified", "removed"):
        assert f"  - {verdict}: " in text
    plain = result_text(result_of([parameter("kt"), parameter("mass", "given")]))
    assert "What the verdicts mean" not in plain
    assert "weak and missing" not in plain
    done = "nothing more to fly: check the result on another flight, with rotorfit validate"
    assert plain.endswith(f"Next step: {done}\n")


def test_doubts_name_their_flight(assert_text):
    assert_text(result_text(sample()))


def test_a_long_name_is_wrapped():
    lines = result_text(result_of([parameter("kt")], name="long name " * 20)).splitlines()
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize("unit", ["1", "kg m^2", "N m s^2/rad^2 per kg"])
def test_units(unit):
    line = rows(result_text(result_of([parameter("kt", unit=unit)])))["kt"]
    assert line.split("0.00020")[1].split() == [
        *([] if unit == "1" else unit.split()),
        "identified",
    ]


def test_numbers_of_two_configurations_stand_with_their_bodies():
    two = [parameter(name, configuration=c) for c in "AB" for name in ("mass", "msx")]
    numbers = [
        Derived(
            name="hover_speed",
            configuration=c,
            value=v,
            std=1.0,
            interval=(v - 2, v + 2),
            unit="rad/s",
        )
        for c, v in (("A", 900.0), ("B", 950.0))
    ]
    validation = ({"configuration": "B", "flight": "b2.csv", "relative_error": {"Fz": 0.012}},)
    text = result_text(result_of([parameter("kt"), *two], numbers, validation=validation))
    first, second = text.split("Body, configuration B")
    assert "hover_speed" not in first.split("Body")[0]
    assert "900.0 +- 2.0" in first and "950.0 +- 2.0" in second
    assert "  - b2.csv (B): Fz 1.2 %" in text


@pytest.mark.parametrize(
    ("name", "other", "together"),
    [
        ("Ixy", "Izz", True),
        ("Ixx", "Ixx_com", False),
        ("com_x", "com_z", True),
        ("drag_x", "drag_z", True),
        ("drag_x", "drag_moment_xy", False),
        ("kt_1", "kt_2", False),
    ],
)
def test_kin_of_one_unit_are_drawn_over_one_axis(name, other, together):
    assert (axis_of(name) == axis_of(other)) == together
