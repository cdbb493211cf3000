"""Each file word by word; rewritten by  pytest --update-golden."""

import json
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
from export_material import a_result, changed, not_identified, text_of
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rotorfit import version
from rotorfit.export.targets import TARGETS
from rotorfit.findings import doubt

NAMES = {
    "gazebo": "model.sdf",
    "gazebo-motors": "motors.sdf",
    "px4": "px4.params",
    "px4-gazebo": "px4_gazebo.params",
    "px4-sih": "sih.params",
    "px4-setpoints": "px4_setpoints.json",
    "mujoco": "mujoco.xml",
    "urdf": "vehicle.urdf",
    "gym-pybullet-drones": "gym_pybullet_drones.urdf",
    "rotorpy": "rotorpy_params.py.txt",
    "ardupilot": "ardupilot.param",
    "ardupilot-sitl": "ardupilot.json",
    "betaflight": "betaflight.txt",
    "indiflight": "indiflight.txt",
    "paparazzi": "paparazzi.xml",
    "crazyflow": "crazyflow.toml",
    "casadi": "casadi_dynamics.py.txt",
}


@pytest.fixture
def golden_of_any_version(golden):
    """Return what a golden file holds, in whose text one version stands for all."""

    def expected(name, text):
        written = f"written by rotorfit {version.__version__} "
        assert text.count(written) == 1
        of_one_version = "written by rotorfit 1.2.3 "
        kept = golden(name, text.replace(written, of_one_version))
        return kept.replace(of_one_version, written)

    return expected


def test_every_target_has_a_file():
    assert NAMES.keys() == TARGETS.keys()


@pytest.mark.parametrize("target", sorted(NAMES))
def test_file(golden_of_any_version, target):
    text = text_of(a_result(), target)
    assert text == golden_of_any_version(f"export/{NAMES[target]}", text)


def test_file_with_doubts(golden_of_any_version):
    """A weak number, a removed one, one assumed, one made of a ratio, and none for Jr."""
    doubtful = changed(
        a_result(law=None),
        msz={"verdict": "weak", "reason": "known only to +-40 %"},
        kd=not_identified("ratio-only"),
        Izz=not_identified("ratio-only"),
        Izz_com=not_identified_derived(),
        Jr=not_identified(),
        Jr_over_Izz=not_identified_derived(),
        kt_2=not_identified(),
    )
    assumed = {"Izz_com": 0.03, "motor_lag": 0.04, "max_speed": 1050.0}
    text = text_of(doubtful, "mujoco", assumed=assumed)
    assert text == golden_of_any_version("export/doubts.xml", text)


READERS = {
    "gazebo": ET.fromstring,
    "mujoco": ET.fromstring,
    "urdf": ET.fromstring,
    "gym-pybullet-drones": ET.fromstring,
    "paparazzi": ET.fromstring,
    "px4-setpoints": json.loads,
    "rotorpy": lambda text: compile(text, "params.py", "exec"),
    "casadi": lambda text: compile(text, "vehicle.py", "exec"),
    "crazyflow": tomllib.loads,
}


@settings(max_examples=25, deadline=None)
@given(words=st.text(max_size=30))
@example(words="--> <!-- ]]> --- -")
@example(words="a\nimport os\x00\u2028b")
@example(words='"""\\')
def test_any_name_leaves_the_file_readable(words):
    """Names of experiments, flights and configurations are the user's, and are any text."""
    result = a_result()
    flight = replace(result.flights[0], file=words)
    named = replace(result, name=words, flights=(flight,), findings=(doubt("made", words),))
    for target, read in READERS.items():
        text = text_of(named, target, draws=3)  # the intervals' numbers are not looked at
        assert read(
            text.encode("utf-8")
            if target in ("gazebo", "mujoco", "urdf", "gym-pybullet-drones")
            else text
        )
    lines = text_of(named, "px4").split("\n")
    assert all(line.startswith("#") or line.count("\t") == 4 for line in lines if line)


def not_identified_derived():
    return {"value": None, "std": None, "interval": None}
