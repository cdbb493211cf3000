"""rotorfit compare beside the truth of a simulated flight."""

import json
import sys
from dataclasses import replace
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "export"))
from export_material import KT, a_result, changed, parameter


def test_a_result_next_to_its_truth(run, tmp_path, monkeypatch, assert_wording):
    monkeypatch.chdir(tmp_path)
    a_result().save(tmp_path / "result.json")
    truth = {"shared": {"kt": 1.005 * KT}, "configurations": {"A": {"mass": 1.285, "Ixx": 0.03}}}
    (tmp_path / "truth.json").write_text(json.dumps({"seed": 1, **truth}))
    ended = run("compare", "result.json", "truth.json")
    assert (ended.code, ended.err) == (0, "")
    lines = {line.split()[0]: line for line in ended.out.splitlines() if line.strip()}
    assert lines["kt"].endswith("+0.50 %  N s^2/rad^2")
    assert "%*" in lines["Ixx"]
    assert "the 95 %" in ended.out
    assert_wording(ended.out)


def test_a_truth_that_is_damaged_is_refused(refused, tmp_path, monkeypatch, assert_wording):
    monkeypatch.chdir(tmp_path)
    a_result().save(tmp_path / "result.json")
    (tmp_path / "truth.json").write_text('{"shared": 3, "configurations": {}}')
    assert_wording(refused("compare", "result.json", "truth.json"))
    words = refused("compare", "truth.json", "truth.json")
    assert_wording(words)


def test_the_delay_of_commands_is_next_to_its_own(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = a_result()
    delay = replace(result.parameters[0], name="command_delay", unit="s", value=0.0108,
                    interval=(0.009, 0.0126))  # fmt: skip
    replace(result, parameters=(*result.parameters, delay)).save(tmp_path / "result.json")
    truth = {"shared": {"motor_delay": 0.01}, "configurations": {"A": {"mass": 1.285}}}
    (tmp_path / "truth.json").write_text(json.dumps({"seed": 1, **truth}))
    lines = run("compare", "result.json", "truth.json").out.splitlines()
    (line,) = (line for line in lines if line.startswith("command_delay"))
    assert "0.01 " in line
    assert "*" not in line


def test_a_shared_number_stands_once(run, tmp_path, monkeypatch):
    """truth.json lists rotor_drag with each configuration; results have it shared."""
    monkeypatch.chdir(tmp_path)
    made = changed(a_result(), Jr=None)
    made = replace(made, parameters=(*made.parameters, parameter("rotor_drag", 1.2e-4)))
    made.save(tmp_path / "result.json")
    truth = {"shared": {"kt": KT}, "configurations": {"A": {"mass": 1.285, "rotor_drag": 1e-4}}}
    (tmp_path / "truth.json").write_text(json.dumps({"seed": 1, **truth}))
    lines = run("compare", "result.json", "truth.json").out.splitlines()
    (line,) = [line for line in lines if line.startswith("rotor_drag")]
    assert "1.200" in line and "1e-04" in line
