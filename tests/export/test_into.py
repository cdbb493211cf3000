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
        (MINE, "urdf", "--into is for lists of parameters"),
    ],
)
def test_another_kind_of_file_is_refused(own, target, reason):
    with pytest.raises(OutputError, match=reason):
        patched(own, NEW, target)


def sdf(*, mass="1.2", com="0.01 -0.02 0.03", kt="8.5e-06", shift=0.0, spins=("ccw", "cw")):
    """A model with four rotors, its origin shifted along x [m]."""
    inertia = "".join(f"<{k}>{v}</{k}>" for k, v in (("ixx", 0.01), ("iyy", 0.02), ("izz", 0.03)))
    inertial = f"<mass>{mass}</mass><inertia>{inertia}</inertia>"
    text = f"<link name='base_link'><inertial><pose>{com} 0 0 0</pose>{inertial}</inertial></link>"
    for i, (x, y) in enumerate(((0.1, -0.1), (-0.1, 0.1), (0.1, 0.1), (-0.1, -0.1))):
        motor = {
            "linkName": f"prop{i}",
            "turningDirection": spins[i // 2],
            "timeConstantUp": "0.02",
            "timeConstantDown": "0.03",
            "maxRotVelocity": "1000",
            "motorConstant": kt,
            "momentConstant": "0.016",
            "rotorVelocitySlowdownSim": "10",
        }
        fields = "".join(f"<{key}>{value}</{key}>" for key, value in motor.items())
        text += (
            f"<link name='prop{i}'><pose>{x + shift} {y} 0 0 0 0</pose>"
            f"<inertial>{inertial}</inertial>"
            f"</link><joint name='j{i}'><parent>base_link</parent><child>prop{i}</child></joint>"
            f"<plugin name='m'>{fields}</plugin>"
        )
    return (
        f"<?xml version='1.0'?>\r\n<sdf version='1.9'><model name='mine'>{text}</model></sdf>\r\n"
    )


def test_a_model_keeps_all_but_its_numbers():
    mine = sdf(shift=0.05).replace("<mass>1.2<", "<!-- weighed --><mass> 1.2 <", 1)
    new = patched(mine, sdf(mass="1.5", kt="9e-06"), "gazebo")
    expected = (
        mine.replace("> 1.2 <", "> 1.5 <").replace(">1.2<", ">1.5<").replace("8.5e-06", "9e-06")
    )
    # The CoM moves by as much as the model's origin lies elsewhere.
    assert new.text == expected.replace("0.01 -0.02 0.03 0 0 0", "0.06 -0.02 0.03 0 0 0")
    assert ("base_link mass 1.2", "base_link mass 1.5") in new.changed
    assert ("prop3 motorConstant 8.5e-06", "prop3 motorConstant 9e-06") in new.changed
    assert len(new.changed) == 10  # the CoM, five masses, four motors
    assert patched(mine, mine, "gazebo").changed == ()


@pytest.mark.parametrize(
    ("mine", "words"),
    [
        ("P,1", "no XML"),
        ("<sdf><world/></sdf>", "no body with motors in it"),
        (sdf(spins=("cw", "ccw")), "prop0 turns cw in the model, ccw in flight"),
        (sdf().replace("0.1 0.1 0 0", "0.2 0.1 0 0"), "mm from the nearest rotor"),
        (sdf().replace("<timeConstantUp>0.02</timeConstantUp>", "", 1), "add the element"),
    ],
)
def test_a_model_of_another_vehicle_is_refused(mine, words):
    with pytest.raises(OutputError, match=words):
        patched(mine, sdf(), "gazebo")
