"""What inspect says of the thrust, of an axis and of gaps, sentence by sentence."""

from dataclasses import replace

import pytest

from rotorfit.estimation.measured import Measured
from rotorfit.report.log_report import (
    flight_messages,
    prospect_messages,
    recording_messages,
)
from rotorfit.tools.inspection.inspect_log import LogReport
from rotorfit.tools.inspection.prospects import Commands, Excitation, Prospects, Thrust
from rotorfit.tools.inspection.recording import ChannelReport

THRUST = Thrust(
    change=0.13,
    from_changes=6.6,
    from_weight=7.4,
    agree=True,
    width=0.02,
    followed=True,
    ratio=Measured(value=6.6 / 7.4, std=0.02),
)
YAW = Excitation(axis="yaw", turning=0.7, rho=137.0, width=0.02)
ROLL = Excitation(axis="roll", turning=51.2, rho=4.0, width=0.4)
CHANNEL = ChannelReport(
    name="gyro",
    columns=3,
    unit="rad/s",
    samples=1000,
    missing=0,
    rate=200.0,
    true_rate=200.0,
    jitter=0.0,
    gaps=1,
    longest_gap=2.1,
    at_limit=0.0,
    resolution=None,
    source="IMU",
)


def said(thrust=THRUST, axis=YAW, *, commanded=False):
    found = Prospects(excitation=(axis,), thrust=thrust, commanded=commanded, motors=None)
    return prospect_messages(found)


@pytest.mark.parametrize(
    ("thrust", "words"),
    [
        (THRUST, "kt (per kilogram) can be found well"),
        (replace(THRUST, change=0.012), "thrust changes by 1.2 % only: kt from the weight alone"),
        (replace(THRUST, width=0.4), "can be found roughly: too few changes of thrust"),
        (replace(THRUST, width=None), "kt cannot be found: too few changes of thrust"),
        (
            replace(THRUST, agree=False, width=0.15),
            "can be found, but by these changes kt is 10.8 +- 3.9 % lower than by the weight "
            "(without the turns, which identify weighs, too). Drag in climb and descent may be",
        ),
        (
            replace(THRUST, width=0.3, law_full=0.25),
            "roughly. Full thrust is known to +-25 % only, for want of a law from command to rotor "
            "speed: give it under [motors], or log the rotor speed",
        ),
        (
            replace(THRUST, followed=False),
            "can be found by the weight. Neither roll nor pitch",
        ),
    ],
    ids=["well", "calm", "roughly", "not", "two values", "no law", "unfollowed"],
)
def test_the_thrust(thrust, words):
    assert words in said(thrust, commanded=True)[0]


COMMANDS = Commands(law_known=False, limited=0.12, lag=0.05, seen_lag=0.023, rate=500.0)


def test_a_law_by_settings_is_no_missing_law(assert_wording):
    known = replace(COMMANDS, law_known=True)
    found = Prospects(
        excitation=(YAW,),
        thrust=replace(THRUST, law_full=0.19),
        commanded=True,
        motors=None,
        commands=known,
    )
    assert_wording(prospect_messages(found)[0])


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        (
            COMMANDS,
            "but not the slow ones that a pilot flies: the law from command to rotor speed is not "
            "known, or a motor is at its limit in 12 % of the flight, or slow turns fit a motor "
            "lag of 50 ms, quick ones 23 ms. Log the rotor speed, or give law and lag",
        ),
        (replace(COMMANDS, rate=10.0), "Commands at 10 Hz are too slow to explain the turns"),
        (replace(COMMANDS, law_known=True, limited=0.0, lag=0.023), "flies. Log the rotor speed"),
    ],
)
def test_commands_that_explain_nothing_say_what_is_wrong(commands, words, assert_wording):
    """Where the flight names the motor order, the vehicle does follow its commands."""
    thrust, axis = replace(THRUST, followed=False), replace(YAW, rho=0.0, width=None)
    found = Prospects(
        excitation=(axis,), thrust=thrust, commanded=True, motors="quad-x", commands=commands
    )
    of_thrust, of_yaw = prospect_messages(found)
    assert words in of_thrust
    assert "neither roll nor pitch" not in of_thrust
    assert_wording(of_yaw)


def test_two_kt_with_a_known_law_are_no_matter_of_the_law(assert_wording):
    differing = replace(THRUST, agree=False, width=0.15)
    [measured, _] = said(differing)
    found = Prospects(
        excitation=(YAW,),
        thrust=differing,
        commanded=True,
        motors=None,
        commands=replace(COMMANDS, law_known=True),
    )
    for words in (measured, prospect_messages(found)[0]):
        assert_wording(words)


@pytest.mark.parametrize(
    ("axis", "words"),
    [
        (
            YAW,
            "yaw (0.7 rad/s^2): kd / Izz can be found well (to about +-2 %); Izz, kd and Jr less",
        ),
        (
            replace(YAW, rho=1.2, width=None),
            "cannot be found; noise and gusts hide the motion (signal-to-noise 1.2, need 5)",
        ),
        (
            ROLL,
            "roll (51 rad/s^2): Ixx roughly (to about +-40 %); roll is not much stronger",
        ),
        (replace(ROLL, rho=40.0), "Ixx roughly (to about +-40 %); fly more of this motion"),
    ],
)
def test_an_axis(axis, words):
    assert words in said(axis=axis)[1]


def test_no_axis_is_found_well_in_a_log_that_is_too_slow(assert_text):
    """Its forecast knows nothing of what is between its samples: kd / Izz came to +-31 %."""
    slow = Prospects(
        excitation=(YAW,),
        thrust=THRUST,
        commanded=True,
        motors=None,
        useless_because="a log at 10 Hz shows no quick motion",
    )
    assert_text(prospect_messages(slow)[1])


def test_an_axis_that_waits_for_kt(assert_text):
    weak = replace(THRUST, width=0.5)
    assert_text(said(weak, replace(ROLL, rho=40.0))[1])


def test_an_axis_of_which_the_law_leaves_most_open(assert_wording):
    open_law = replace(THRUST, law_reach=0.35)
    assert_wording(said(open_law, replace(ROLL, rho=40.0))[1])


def report(**changes):
    return LogReport(file="a", format="table", log="1 of 1", seconds=10.0, **changes)


def test_one_gap_is_no_gaps(assert_text):
    assert_text(recording_messages(report(channels=(CHANNEL,))))
    two = replace(CHANNEL, gaps=2, name="battery")
    assert_text(recording_messages(report(channels=(two,))))


def test_a_share_has_no_exponent():
    all_of_it = replace(CHANNEL, gaps=0, at_limit=0.998)
    [words] = recording_messages(report(channels=(all_of_it,)))
    assert "99.8 % of the samples" in words
    [words] = recording_messages(report(channels=(replace(all_of_it, at_limit=1.0),)))
    assert "100 % of the samples" in words


@pytest.mark.parametrize(
    ("late", "words"),
    [
        (0.004, "the vehicle responds 4 ms after the motor data"),
        (0.018, "write delay = 0.018 under [motors], as"),
        (0.04, "log those measured"),
        (0.2, "no motor is so slow; bring motor data and IMU on one clock"),
        (-0.1, "recorded 100 ms after the motion that they cause: their clocks differ"),
    ],
)
def test_lateness(late, words):
    speed = replace(CHANNEL, name="rotor_speed", gaps=0)
    [told] = flight_messages(report(channels=(speed,), motor_lateness=late))
    assert words in told


def test_commands_that_follow_the_motion_are_an_autopilot_alone(assert_wording):
    command = replace(CHANNEL, name="command", gaps=0)
    [told] = flight_messages(report(channels=(command,), motor_lateness=-0.006))
    assert "by 6 ms" in told
    assert_wording(told)
    [told] = flight_messages(report(channels=(command,), motor_lateness=-0.1))
    assert "their clocks differ" in told


def test_no_motion_is_asked_for_of_a_log_that_is_too_slow(assert_text):
    slow = Prospects(
        excitation=(replace(ROLL, width=None),),
        thrust=THRUST,
        commanded=True,
        motors=None,
        useless_because="a log at 10 Hz shows no quick motion, whatever is flown",
    )
    assert_text(prospect_messages(slow)[1])
