"""Drawn vehicles as files: what stands in them is what was drawn, and their consumers take it."""

import io
import json
import os
import runpy
import sys
import types
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_material import (
    COM,
    DATE,
    INERTIA_COM,
    KD,
    KT_EACH,
    MASS,
    RATES,
    SPEEDS,
    a_result,
    body_of,
    changed,
    com_acceleration,
    motion,
    vehicle,
)

from kept_words import lines_with
from rotorfit.errors import OutputError
from rotorfit.export.write import randomised, variant_files
from rotorfit.results.result import IdentificationResult

TOGETHER = 0.98
"""Correlation of kd and Izz."""


@pytest.fixture(scope="module")
def result() -> IdentificationResult:
    """The vehicle, kd and Izz known to 2 % each and much better together."""
    made = a_result()
    kd, Izz = made.parameter("kd"), made.parameter("Izz")
    std = 0.02 * np.array([kd.value, Izz.value], dtype=float)
    return replace(
        made,
        covariance_names=("kd", "Izz@A"),
        covariance=np.outer(std, std) * np.array([[1.0, TOGETHER], [TOGETHER, 1.0]]),
    )


def drawn(result, target, name="x", **options):
    content, found = randomised(result, target, Path(name), date=DATE, **options)
    return content, found


def test_arrays_hold_the_draws_and_their_correlation(result):
    content, _ = drawn(result, "samples", "v.npz", count=1500, seed=2)
    arrays = np.load(io.BytesIO(content))
    about = json.loads(str(arrays["about"]))
    assert (about["count"], about["seed"], about["rejected"]) == (1500, 2, 0.0)
    assert set(arrays.files) == {"about", *about["units"]}
    kd, Izz = arrays["kd"], arrays["inertia_com"][:, 2, 2]
    assert np.corrcoef(kd, Izz)[0, 1] == pytest.approx(TOGETHER, abs=0.01)
    assert kd.mean() == pytest.approx(KD, rel=0.002)
    np.testing.assert_allclose(arrays["com"].mean(axis=0), COM, rtol=0.01)
    np.testing.assert_allclose(arrays["kt"].mean(axis=0), KT_EACH, rtol=0.001)
    np.testing.assert_allclose(arrays["kt"].std(axis=0), 0.005 * KT_EACH, rtol=0.1)
    np.testing.assert_allclose(np.diag(arrays["inertia_com"].mean(axis=0)), np.diag(INERTIA_COM),
                               rtol=0.01)  # fmt: skip
    assert set(arrays["mass"]) == {MASS}


def test_json_says_the_same_as_npz(result):
    arrays = np.load(io.BytesIO(drawn(result, "samples", "v.npz", count=3)[0]))
    said = json.loads(drawn(result, "samples", "v.json", count=3)[0])
    for name, values in said["values"].items():
        np.testing.assert_array_equal(np.array(values), arrays[name])
    assert said["flights"][0]["file"] == "A1--long.csv"


def test_what_is_assumed_is_the_same_in_all(result):
    _, found = drawn(result, "pegasus", count=5, assumed={"max_speed": 1400.0, "kt": 4e-6})
    assert {m.max_speed for m in found.models} == {1400.0}
    assert {rotor.kt for m in found.models for rotor in m.rotors} == {4e-6}


def test_assumed_numbers_that_no_draw_goes_with_are_refused(result):
    with pytest.raises(OutputError, match="of 20 vehicles drawn cannot exist with what was"):
        drawn(result, "samples", "v.npz", count=20, assumed={"Izz_com": 0.0377})


def test_other_suffixes_are_refused(result):
    with pytest.raises(OutputError, match=r"written as .npz or .json, not .csv; for one file"):
        drawn(result, "samples", "v.csv")


@pytest.mark.parametrize("name", ["mujoco", "urdf"])
def test_one_file_for_each_vehicle(result, name, assert_text):
    files, found = variant_files(result, name, count=12, seed=4, date=DATE)
    assert next(iter(files)).startswith(f"{name}-01.") and len(files) == 12
    assert len(set(files.values())) == 12
    assert_text(lines_with(list(files.values())[-1], "joint posterior"))
    again, _ = variant_files(result, name, count=12, seed=4, date=DATE)
    assert files == again
    assert len(found.models) == 12


def test_mujoco_loads_each_vehicle(result):
    mujoco = pytest.importorskip("mujoco", reason='pip install "rotorfit[mujoco]"')
    files, found = variant_files(result, "mujoco", count=3, date=DATE)
    for text, drew in zip(files.values(), found.models, strict=True):
        model = mujoco.MjModel.from_xml_string(text)
        body = model.body("vehicle")
        np.testing.assert_allclose(body.ipos, drew.com, rtol=1e-9)
        moments = np.sort(np.linalg.eigvalsh(drew.inertia_com))
        np.testing.assert_allclose(np.sort(body.inertia), moments, rtol=1e-9)


def test_pegasus_thrust_curves_move_the_vehicle_by_its_formulas(result):
    """quadratic_thrust_curve.py: forces k w^2, rolling moment c w^2 rot_dir; -1 turns ccw."""
    vehicles = python(drawn(result, "pegasus", count=2)[0])["VEHICLES"]
    for entry in vehicles:
        curve = entry["thrust_curve"]
        assert {len(v) for v in curve.values() if isinstance(v, list)} == {curve["num_rotors"]}
        thrust = np.array(curve["rotor_constant"]) * SPEEDS**2
        arms = vehicle().positions - np.array(entry["com"])
        torque = np.cross(arms, np.outer(thrust, [0.0, 0.0, 1.0])).sum(axis=0)
        torque[2] += (curve["rolling_moment_coefficient"] * SPEEDS**2) @ curve["rot_dir"]
        I = np.array(entry["inertia"])
        body = body_of(kt=curve["rotor_constant"], Jr=0.0, com=entry["com"], inertia_com=I)
        body = replace(body, kd=curve["rolling_moment_coefficient"][0])
        _, dw = motion(body, vehicle())
        rate = np.linalg.solve(I, torque - np.cross(RATES, I @ RATES))
        np.testing.assert_allclose(rate, dw, rtol=1e-9, atol=1e-8)


def test_isaac_lab_ranges_hold_95_percent_of_the_draws(result):
    content, found = drawn(result, "isaac-lab", count=400)
    module = python(content)
    low, high = module["EVENTS"]["com"]["params"]["com_range"]["x"]
    off = np.array([m.com[0] for m in found.models]) - found.nominal.com[0]
    assert np.mean((off >= low) & (off <= high)) == pytest.approx(0.95, abs=0.01)
    thruster = module["THRUSTER"]
    low, high = thruster["thrust_const_range"]
    assert low < found.nominal.kt * (2 * np.pi) ** 2 < high  # N per squared revolution per second
    assert thruster["torque_to_thrust_ratio"] == found.nominal.kd / found.nominal.kt
    assert set(thruster) == {  # isaaclab_contrib/actuators/thruster_cfg.py
        *("thrust_range", "thrust_const_range", "tau_inc_range", "tau_dec_range"),
        "torque_to_thrust_ratio",
    }
    low, high = thruster["thrust_range"]
    assert (low, high) == (0.0, found.nominal.kt * found.nominal.max_speed**2)
    scale = module["EVENTS"]["inertia"]["params"]["inertia_distribution_params"]
    assert scale[0] < 1.0 < scale[1] and scale[1] - scale[0] == pytest.approx(0.08, rel=0.2)


def test_crazyflow_worlds_move_as_their_vehicles(result):
    """By the formulas of dynamics.py, each world with its own numbers."""
    arrays = np.load(io.BytesIO(drawn(result, "crazyflow-worlds", count=3)[0]))
    _, found = drawn(result, "crazyflow-worlds", count=3)
    for i, model in enumerate(found.models):
        p = {name: arrays[name][i, 0] for name in arrays.files if name != "about"}
        rpm = SPEEDS * 60.0 / (2.0 * np.pi)
        thrust = p["rpm2thrust"][:, 2] * rpm**2
        torque = np.array([1.0, 1.0, 0.0]) * (p["mixing_matrix"] @ (thrust * p["L"]))
        torque[2] += (p["mixing_matrix"] @ (p["rpm2torque"][:, 2] * rpm**2))[2]
        momentum = (p["mixing_matrix"][2] * p["prop_inertia"]) @ SPEEDS
        torque += momentum * np.array([RATES[1], -RATES[0], 0.0])
        dw = p["J_inv"] @ (torque - np.cross(RATES, p["J"] @ RATES))
        body = body_of(kt=[r.kt for r in model.rotors], Jr=model.Jr, com=model.com,
                       inertia_com=model.inertia_com)  # fmt: skip
        alpha, expected = motion(replace(body, kd=model.kd), vehicle())
        np.testing.assert_allclose(dw, expected, rtol=1e-9, atol=1e-8)
        lift = com_acceleration(replace(body, kd=model.kd), alpha, expected)[2]
        assert thrust.sum() / p["mass"][0] == pytest.approx(lift, rel=1e-9)


def test_crazyflow_flies_every_world_with_its_own_numbers(result):
    if os.environ.get("SCIPY_ARRAY_API") != "1":
        pytest.skip("crazyflow wants SCIPY_ARRAY_API=1 before SciPy is imported")
    pytest.importorskip("crazyflow", reason="crazyflow is not installed")
    import jax.numpy as jnp
    from crazyflow.dynamics.first_principles.dynamics import dynamics

    arrays = np.load(io.BytesIO(drawn(result, "crazyflow-worlds", count=3)[0]))
    _, found = drawn(result, "crazyflow-worlds", count=3)
    p = {name: jnp.asarray(arrays[name]) for name in arrays.files if name != "about"}
    rpm = jnp.asarray(np.broadcast_to(SPEEDS * 60.0 / (2.0 * np.pi), (3, 1, 4)))
    zeros = jnp.zeros((3, 1, 3))
    moved = dynamics(
        pos=zeros,
        quat=jnp.broadcast_to(jnp.array([0.0, 0.0, 0.0, 1.0]), (3, 1, 4)),
        vel=zeros,
        ang_vel=jnp.broadcast_to(jnp.asarray(RATES), (3, 1, 3)),
        cmd=rpm,
        rotor_vel=rpm,
        gravity_vec=jnp.array([0.0, 0.0, -9.81]),
        **p,
    )
    for i, model in enumerate(found.models):
        body = body_of(kt=[r.kt for r in model.rotors], Jr=model.Jr, com=model.com,
                       inertia_com=model.inertia_com)  # fmt: skip
        _, expected = motion(replace(body, kd=model.kd), vehicle())
        np.testing.assert_allclose(moved[3][i, 0], expected, rtol=1e-4)  # of single precision


def test_a_vehicle_per_command_is_drawn_in_si():
    """Without a law coefficients are per squared command; a speed at full command undoes it."""
    made = a_result(law=None)
    made = replace(made, settings={**made.settings, "motors": {"speed": "commanded"}})
    made = changed(
        made,
        kt={"unit": "N per squared command", "value": 7.0, "std": 0.07, "interval": (6.9, 7.1)},
        kd={"unit": "N m per squared command", "value": 0.1, "std": 0.001, "interval": (0.09, 0.1)},
        Jr=None,
        Jr_over_Izz=None,
        kd_over_Izz=None,
        **{f"kt_{i}": None for i in range(1, 5)},
    )
    content, _ = drawn(made, "samples", "v.npz", count=500, assumed={"max_speed": 1000.0})
    kt = np.load(io.BytesIO(content))["kt"]
    assert kt.mean() == pytest.approx(7.0e-6, rel=0.002)
    assert kt.std() == pytest.approx(0.07e-6, rel=0.1)


def python(content: bytes) -> dict:
    """Return what a written Python file defines."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made.py"
        path.write_bytes(content)
        return runpy.run_path(str(path))


def test_isaac_lab_without_a_term_is_reported(result, monkeypatch):
    """`isaaclab.envs.mdp` of 2.3 has no randomize_rigid_body_inertia."""
    module = python(drawn(result, "isaac-lab", count=20)[0])
    mdp = types.SimpleNamespace(randomize_rigid_body_com="com")
    envs = types.SimpleNamespace(mdp=mdp)
    managers = types.SimpleNamespace(EventTermCfg=lambda **given: given)
    monkeypatch.setitem(sys.modules, "isaaclab", types.SimpleNamespace())
    monkeypatch.setitem(sys.modules, "isaaclab.envs", envs)
    monkeypatch.setitem(sys.modules, "isaaclab.managers", managers)
    with pytest.raises(ImportError, match=r"has no .'randomize_rigid_body_inertia'.: update it"):
        module["event_terms"]("body")
    mdp.randomize_rigid_body_inertia = "inertia"
    terms = module["event_terms"]("body")
    assert [(t["func"], t["mode"]) for t in terms.values()] == [
        ("com", "startup"),
        ("inertia", "startup"),
    ]
    assert {t["params"]["asset_cfg"] for t in terms.values()} == {"body"}


def test_urdf_variants_are_readable_by_gym_pybullet_drones(result):
    """BaseAviary._parseURDFParameters takes elements by their place, all numbers with one value."""
    files, found = variant_files(result, "gym-pybullet-drones", count=3, date=DATE)
    for text, model in zip(files.values(), found.models, strict=True):
        properties, base = list(ET.fromstring(text))[:2]
        inertial, _, collision = base
        assert float(inertial[1].attrib["value"]) == pytest.approx(model.mass, rel=1e-9)
        tensor = [float(inertial[2].attrib[f"i{a}{a}"]) for a in "xyz"]
        np.testing.assert_allclose(tensor, np.diag(model.inertia_com), rtol=1e-9)
        assert {"length", "radius"} <= set(collision[1][0].attrib)
        assert len([float(s) for s in collision[0].attrib["xyz"].split(" ")]) == 3
        rpm = 2.0 * np.pi / 60.0
        mean = np.mean([rotor.kt for rotor in model.rotors])
        assert float(properties.attrib["kf"]) == pytest.approx(mean * rpm**2, rel=1e-9)
        assert float(properties.attrib["km"]) == pytest.approx(model.kd * rpm**2, rel=1e-9)
        for name in (
            *("arm", "thrust2weight", "max_speed_kmh", "gnd_eff_coeff", "prop_radius"),
            *("drag_coeff_xy", "drag_coeff_z", "dw_coeff_1", "dw_coeff_2", "dw_coeff_3"),
        ):
            assert np.isfinite(float(properties.attrib[name])), name


@pytest.mark.parametrize(("target", "name"), [("samples", "v.npz"), ("crazyflow-worlds", "w.npz")])
def test_npz_files_hold_no_other_array_with_the_lowest_numpy(result, monkeypatch, target, name):
    """NumPy 1.26 to 2.1 has no option allow_pickle: every keyword is an array."""
    given = {}
    monkeypatch.setattr(np, "savez", lambda file, **arrays: given.update(arrays))
    drawn(result, target, name, count=3)
    assert "about" in given and "allow_pickle" not in given
