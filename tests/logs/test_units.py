import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.errors import LogError
from rotorfit.logs.columns import GROUPS, QUATERNION, ROTORS
from rotorfit.logs.flight_log import CHANNELS
from rotorfit.logs.units import UNITS, conversion, si_unit


@pytest.mark.parametrize(
    ("quantity", "unit", "recorded", "si"),
    [
        ("time", "s", 2.5, 2.5),
        ("time", "ms", 2500.0, 2.5),
        ("time", "us", 2.5e6, 2.5),
        ("time", "µs", 2.5e6, 2.5),
        ("time", "ns", 2.5e9, 2.5),
        ("angular velocity", "deg/s", 180.0, math.pi),
        ("angular velocity", "dps", 180.0, math.pi),
        ("angular velocity", "mrad/s", 1.0, 1e-3),
        ("rotor speed", "rpm", 60.0, 2 * math.pi),
        ("rotor speed", "Hz", 1.0, 2 * math.pi),
        ("rotor speed", "deg/s", 360.0, 2 * math.pi),
        ("acceleration", "g", 1.0, 9.80665),
        ("acceleration", "mg", 1000.0, 9.80665),
        ("acceleration", "m/s2", 3.0, 3.0),
        ("command", "%", 50.0, 0.5),
        ("command", "", 0.5, 0.5),
        ("voltage", "mV", 12600.0, 12.6),
        ("velocity", "cm/s", 100.0, 1.0),
        ("velocity", "mm/s", 1000.0, 1.0),
        ("position", "cm", 100.0, 1.0),
        ("position", "mm", 1000.0, 1.0),
        ("angle", "deg", 180.0, math.pi),
        ("quaternion", "1", 0.5, 0.5),
    ],
)
def test_a_recorded_value_becomes_its_si_value(quantity, unit, recorded, si):
    assert conversion(quantity, unit)(np.array([recorded]))[0] == pytest.approx(si, rel=1e-15)


def test_electrical_revolutions_are_divided_by_the_pole_pairs():
    to_si = conversion("rotor speed", "erpm", motor_poles=14)
    assert to_si(np.array([7 * 60.0]))[0] == pytest.approx(2 * math.pi)


@given(st.integers(1, 30), st.floats(0, 1e6))
def test_erpm_agrees_with_rpm_of_the_rotor(pairs, rpm):
    electrical = conversion("rotor speed", "erpm", motor_poles=2 * pairs)
    mechanical = conversion("rotor speed", "rpm")
    np.testing.assert_allclose(
        electrical(np.array([rpm * pairs])), mechanical(np.array([rpm])), rtol=1e-12
    )


@given(st.floats(-1e5, 1e5), st.floats(1e-3, 1e5), st.floats(0, 1))
def test_a_range_takes_stop_to_0_and_full_to_1(low, width, fraction):
    to_si = conversion("command", "us", recorded_range=(low, low + width))
    recorded = np.array([low + fraction * width])
    assert to_si(recorded)[0] == pytest.approx(fraction, abs=1e-6)


def test_every_channel_has_its_unit_as_the_first_of_its_quantity():
    for group in GROUPS:
        if group.channel != "attitude":
            assert si_unit(group.quantity) == CHANNELS[group.channel][1]
    for channel, quantity in ROTORS.values():
        assert si_unit(quantity) == CHANNELS[channel][1]
    assert si_unit(QUATERNION.quantity) == CHANNELS["attitude"][1]
    assert all(UNITS[quantity][si_unit(quantity)] == 1.0 for quantity in UNITS)


@pytest.mark.parametrize(
    ("quantity", "unit", "options", "message"),
    [
        (
            "angular velocity",
            "degs/s",
            {},
            "unknown unit 'degs/s' of angular velocity: did you mean 'deg/s'? "
            "known are rad/s, mrad/s, deg/s, mdeg/s, rpm, Hz",
        ),
        ("voltage", "mv", {}, "unknown unit 'mv' of voltage: did you mean 'mV'? known are V, mV"),
        ("time", "fortnights", {}, "unknown unit 'fortnights' of time: known are s, ms, us, ns"),
        (
            "rotor speed",
            "erpm",
            {},
            "rotor speeds in erpm need the number of magnet poles of the motors: "
            "give motor_poles (often 14), or record rpm",
        ),
        (
            "rotor speed",
            "erpm",
            {"motor_poles": 7},
            "motor_poles = 7: magnet poles come in pairs, 2 or more",
        ),
        (
            "command",
            "us",
            {},
            "a command in us needs the recorded values of stop and full: "
            "add range = [1000, 2000] or what the log uses",
        ),
        (
            "command",
            "counts",
            {},
            "a command in counts needs the recorded values of stop and full: "
            "add range = [0, 65535] or what the log uses",
        ),
        (
            "command",
            "us",
            {"recorded_range": (1000.0, 1000.0)},
            "range = [1000, 1000] of a command: the recorded values of stop and of full "
            "must be two different finite numbers",
        ),
    ],
)
def test_what_cannot_be_converted_is_refused(quantity, unit, options, message):
    with pytest.raises(LogError, match=f"^{re.escape(message)}$"):
        conversion(quantity, unit, **options)
