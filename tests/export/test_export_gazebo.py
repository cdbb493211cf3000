"""The SDF model: libsdformat takes it, and its links and plugins together are the vehicle."""

import shutil
import subprocess
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from export_material import (
    COM,
    IMU,
    INERTIA_COM,
    JR,
    KD,
    KT_EACH,
    LAG,
    MASS,
    ROTORS,
    a_result,
    changed,
    flat,
    not_identified,
    saved,
    steiner,
    text_of,
)
from scipy.spatial.transform import Rotation

from kept_words import lines_with
from rotorfit.errors import OutputError

TILTED = [(0.1, 0.0, 0.99498743710662), (0.0, -0.2, 0.9797958971132712), *[(0.0, 0.0, 1.0)] * 2]


def numbers(text):
    return np.array([float(v) for v in text.split()])


def links_of(root):
    """Return mass, CoM and inertia about it of every link, in the model's axes."""
    for link in root.iter("link"):
        pose = link.find("pose")
        place = np.zeros(6) if pose is None else numbers(pose.text)
        turn = Rotation.from_euler("xyz", place[3:]).as_matrix()
        inertial = link.find("inertial")
        own = numbers(inertial.find("pose").text)
        assert not own[3:].any()
        I = {e.tag: float(e.text) for e in inertial.find("inertia")}
        tensor = np.array(
            [
                [I["ixx"], I["ixy"], I["ixz"]],
                [I["ixy"], I["iyy"], I["iyz"]],
                [I["ixz"], I["iyz"], I["izz"]],
            ]
        )
        mass = float(inertial.find("mass").text)
        yield link.attrib["name"], mass, place[:3] + turn @ own[:3], turn @ tensor @ turn.T, turn


def plugins_of(root):
    return [{e.tag: e.text for e in plugin} for plugin in root.iter("plugin")]


@pytest.mark.parametrize("axes", [None, TILTED], ids=["upright", "tilted"])
def test_libsdformat_takes_it(tmp_path, axes):
    tool = shutil.which("ign") or shutil.which("gz")
    if tool is None:
        pytest.skip("ign sdf is not installed (Debian: ignition-tools libsdformat-dev)")
    path = saved(tmp_path, a_result(axes=axes), "gazebo", "model.sdf")
    ended = subprocess.run([tool, "sdf", "-k", path], capture_output=True, text=True, timeout=600)
    if "I cannot find any available 'ign' command" in ended.stdout + ended.stderr:
        pytest.skip("ign has no sdf command (Debian: libsdformat-dev)")
    assert ended.stdout.strip() == "Valid.", ended.stdout + ended.stderr


@pytest.mark.parametrize("axes", [None, TILTED], ids=["upright", "tilted"])
def test_all_links_together_are_the_vehicle(axes):
    root = ET.fromstring(text_of(a_result(axes=axes), "gazebo"))
    parts = list(links_of(root))
    assert [part[0] for part in parts] == ["base_link", *(f"rotor_{i}" for i in range(4))]
    mass = sum(part[1] for part in parts)
    com = sum(part[1] * part[2] for part in parts) / mass
    origin = sum(tensor + steiner(m, c) for _, m, c, tensor, _ in parts)
    assert mass == pytest.approx(MASS, rel=1e-9)
    np.testing.assert_allclose(com, COM, rtol=0, atol=1e-10)
    tensor = origin - steiner(mass, com)
    np.testing.assert_allclose(tensor, INERTIA_COM, rtol=0, atol=1e-9 * INERTIA_COM.max())
    imu = next(root.iter("sensor")).find("pose").text
    np.testing.assert_allclose(numbers(imu)[:3], IMU)


def test_names_of_shapes_are_unique_in_the_whole_model():
    # SDF asks for it in each link only, but rod, which turns SDF into URDF, mistakes equal names.
    root = ET.fromstring(text_of(a_result(), "gazebo"))
    names = [e.attrib["name"] for kind in ("visual", "collision") for e in root.iter(kind)]
    assert len(set(names)) == len(names) == 6


def test_rotors_have_place_axis_and_angular_momentum():
    root = ET.fromstring(text_of(a_result(axes=TILTED), "gazebo"))
    plugin = plugins_of(root)[0]
    for i, (name, _, _, tensor, turn) in enumerate(list(links_of(root))[1:]):
        assert name == f"rotor_{i}"
        axis = turn @ [0, 0, 1]
        np.testing.assert_allclose(axis, TILTED[i], atol=1e-9)
        spin = float(axis @ tensor @ axis)
        speed = 900.0
        joint_speed = speed / float(plugin["rotorVelocitySlowdownSim"])
        assert spin * joint_speed == pytest.approx(JR * speed, rel=1e-9)


@pytest.mark.parametrize("target", ["gazebo", "gazebo-motors"])
def test_plugins_give_thrust_and_reaction(target):
    text = text_of(a_result(), target)
    root = ET.fromstring(text if target == "gazebo" else f"<model>{text}</model>")
    plugins = plugins_of(root)
    assert [int(p["motorNumber"]) for p in plugins] == [0, 1, 2, 3]
    assert [p["actuator_number"] for p in plugins] == [p["motorNumber"] for p in plugins]
    speeds = np.array([800.0, 850.0, 900.0, 700.0])
    for i, plugin in enumerate(plugins):
        spin = {"ccw": 1, "cw": -1}[plugin["turningDirection"]]
        assert plugin["turningDirection"] == ROTORS[i][1]
        # MulticopterMotorModel: thrust = c w^2, torque on the parent = -direction c_m thrust
        thrust = float(plugin["motorConstant"]) * speeds[i] ** 2
        assert thrust == pytest.approx(KT_EACH[i] * speeds[i] ** 2, rel=1e-9)
        torque = -spin * float(plugin["momentConstant"]) * thrust
        assert torque == pytest.approx(-spin * KD * speeds[i] ** 2, rel=1e-9)
        assert float(plugin["timeConstantUp"]) == float(plugin["timeConstantDown"]) == LAG
        assert float(plugin["maxRotVelocity"]) == pytest.approx(1100.0)
        # Their defaults are not zero, and rotorfit does not know them.
        assert float(plugin["rotorDragCoefficient"]) == 0.0
        assert float(plugin["rollingMomentCoefficient"]) == 0.0


def test_up_and_down_may_differ():
    assumed = {"motor_lag_up": 0.02, "motor_lag_down": 0.05}
    text = text_of(a_result(law=None), "gazebo", assumed={**assumed, "max_speed": 1000.0})
    plugin = plugins_of(ET.fromstring(text))[3]
    assert (plugin["timeConstantUp"], plugin["timeConstantDown"]) == ("0.02", "0.05")


def test_without_rotor_inertia_links_are_light_with_a_note(assert_wording):
    text = text_of(changed(a_result(), Jr=not_identified()), "gazebo")
    assert_wording(lines_with(text, "Jr is not known"))
    spins = [tensor[2, 2] for name, _, _, tensor, _ in links_of(ET.fromstring(text))][1:]
    assert max(spins) < 1e-3 * INERTIA_COM[2, 2]


def test_rotor_inertia_larger_than_the_body_is_refused():
    heavy = changed(a_result(), Jr={"value": 4e-3, "interval": (3e-3, 5e-3)})
    with pytest.raises(OutputError, match="Jr is too large for the vehicle"):
        text_of(heavy, "gazebo")


def test_without_jr_the_spin_inertia_is_said_to_be_none(assert_wording):
    text = text_of(flat(), "gazebo")
    assert "0.0001 of" in text
    assert_wording(lines_with(text, "Jr is not known"))
    assert "spin inertia is 10 Jr" not in text
    assert "spin inertia is 10 Jr" in text_of(a_result(), "gazebo")
