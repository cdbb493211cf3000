"""What a caller hands to the public functions: paths as text, and the wrong kind of thing."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import rotorfit

AIRFRAME = '[airframe]\nlayout = "quad-x"\narm = 0.1\norder = "px4"\n[motors]\nspeed = "measured"\n'


def refusal(function, *args, **kwargs) -> str:
    with pytest.raises(TypeError) as refused:
        function(*args, **kwargs)
    return str(refused.value)


def test_a_path_may_be_text(tmp_path):
    file = tmp_path / "airframe.toml"
    file.write_text(AIRFRAME)
    by_text, by_path = (
        rotorfit.single_flight_experiment(log, mass=1.0, airframe=airframe)
        for log, airframe in (("a.csv", str(file)), (Path("a.csv"), file))
    )
    assert by_text == by_path


def test_a_number_may_be_of_numpy():
    rotors = rotorfit.layout_rotors("quad-x", arm=np.float64(0.1))
    assert rotors == rotorfit.layout_rotors("quad-x", arm=0.1)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: rotorfit.identify("experiment.toml"),
            "identify: experiment is 'experiment.toml', expected Experiment "
            "(rotorfit.load_experiment makes one)",
        ),
        (
            lambda: rotorfit.prepare(Path("a.csv"), rotor_count=4, arm=0.1),
            "expected FlightLog (rotorfit.read_log makes one)",
        ),
        (lambda: rotorfit.read_log(None), "read_log: path is None, expected a path"),
        (
            lambda: rotorfit.simulate("folder", "single", "reel"),
            "simulate: variant is 'reel', expected 'clean' or 'lag' or 'noisy' or 'real'; "
            "did you mean 'real'?",
        ),
        (
            lambda: rotorfit.single_flight_experiment("a.csv", mass="1.2 kg", airframe="b.toml"),
            "mass is '1.2 kg', expected a number or 'unknown'",
        ),
        (
            lambda: rotorfit.layout_rotors("quad-x", arm=True),
            "layout_rotors: arm is True, expected a number",
        ),
        (
            lambda: rotorfit.compare_results(["a.json"], ["a"]),
            "results is of type list, expected a list, each IdentificationResult",
        ),
    ],
)
def test_the_wrong_kind_is_refused(call, words):
    assert words in refusal(call)


def test_unknown_arguments_are_refused_in_pythons_words():
    assert "'length'" in refusal(rotorfit.layout_rotors, "quad-x", arm=0.1, length=0.1)


def test_other_processes_find_a_public_function():
    assert pickle.loads(pickle.dumps(rotorfit.layout_rotors)) is rotorfit.layout_rotors
