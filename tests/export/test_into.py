"""An export into the user's own file changes the lines that it names, and no other letter."""

import pytest

from rotorfit.errors import OutputError
from rotorfit.export.into import patched

MINE = """#NOTE: my copter
ATC_RAT_RLL_P,0.135
MOT_THST_EXPO,0.65
MOT_THST_HOVER , 0.2  # learned
LOG_BITMASK,180222
"""
NEW = "# by rotorfit\nMOT_THST_EXPO,0.72\nMOT_THST_HOVER,0.2\nMOT_SPIN_MIN,0.1\n"


def test_ardupilot_lines_are_replaced_where_they_are():
    found = patched(MINE, NEW, "ardupilot")
    assert found.text == MINE.replace("0.65", "0.72") + "MOT_SPIN_MIN,0.1\n"
    assert found.changed == (
        ("MOT_THST_EXPO,0.65", "MOT_THST_EXPO,0.72"),
        ("", "MOT_SPIN_MIN,0.1"),
    )
    assert found.same == 1


def test_separators_and_line_ends_stay():
    mine = "MOT_THST_EXPO    0.650000\r\nRC1_MIN          1000\r\n"
    assert patched(mine, NEW.splitlines()[1], "ardupilot").text == mine.replace("0.650000", "0.72")


def test_px4_keeps_vehicle_component_and_type():
    mine = "# Vehicle-Id Component-Id Name Value Type\n1\t1\tTHR_MDL_FAC\t0.0\t9\n1\t1\tX\t1\t6\n"
    new = "1\t1\tTHR_MDL_FAC\t0.4\t9\n"
    assert patched(mine, new, "px4").text == mine.replace("\t0.0\t", "\t0.4\t")


DUMP = """# version
batch start
set motor_poles = 14

profile 0

# profile 0
set thrust_linear = 0
set vbat_sag_compensation = 0

profile 1

# profile 1
set thrust_linear = 20

# restore original profile selection
profile {restored}

save
"""


@pytest.mark.parametrize(("restored", "old"), [(0, "0"), (1, "20")])
def test_a_dump_changes_in_the_profile_that_it_restores(restored, old):
    dump = DUMP.format(restored=restored)
    found = patched(dump, "\nset thrust_linear = 75\n", "betaflight")
    assert found.changed == ((f"set thrust_linear = {old}", "set thrust_linear = 75"),)
    assert found.text == dump.replace(f"thrust_linear = {old}\n", "thrust_linear = 75\n")


def test_a_difference_of_settings_gets_its_line_before_save():
    found = patched("set motor_poles = 12\nsave\n", "set thrust_linear = 75\n", "betaflight")
    assert found.text == "set motor_poles = 12\nset thrust_linear = 75\nsave\n"


def test_a_second_time_changes_nothing():
    once = patched(MINE, NEW, "ardupilot")
    again = patched(once.text, NEW, "ardupilot")
    assert (again.text, again.changed, again.same) == (once.text, (), 3)


@pytest.mark.parametrize(
    ("own", "target", "reason"),
    [
        ("<sdf/>", "px4", "has no parameter as px4 writes them"),
        (MINE, "gazebo", "--into is for lists of parameters"),
    ],
)
def test_another_kind_of_file_is_refused(own, target, reason):
    with pytest.raises(OutputError, match=reason):
        patched(own, NEW, target)
