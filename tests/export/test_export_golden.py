"""Each file word by word; rewritten by  pytest --update-golden."""

import pytest
from export_material import a_result, changed, not_identified, text_of

import rotorfit
from rotorfit.export.targets import TARGETS

NAMES = {
    "gazebo": "model.sdf",
    "gazebo-motors": "motors.sdf",
    "px4": "px4.params",
    "px4-sih": "sih.params",
    "mujoco": "mujoco.xml",
    "urdf": "vehicle.urdf",
    "rotorpy": "rotorpy_params.py.txt",
    "ardupilot-sitl": "ardupilot.json",
    "crazyflow": "crazyflow.toml",
    "casadi": "casadi_dynamics.py.txt",
}


@pytest.fixture(autouse=True)
def one_version(monkeypatch):
    monkeypatch.setattr(rotorfit, "__version__", "1.2.3")


def test_every_target_has_a_file():
    assert NAMES.keys() == TARGETS.keys()


@pytest.mark.parametrize("target", sorted(NAMES))
def test_file(golden, target):
    golden(f"export/{NAMES[target]}", text_of(a_result(), target))


def test_file_with_doubts(golden):
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
    golden("export/doubts.xml", text_of(doubtful, "mujoco", assumed=assumed))


def not_identified_derived():
    return {"value": None, "std": None, "interval": None}
