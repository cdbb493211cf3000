"""The study of joint fits counts what is lost, wider, or outside, and nothing else."""

from benchmarks.joint_worlds import is_worse, report

TRUTH = {"kt": 1.0, "kd": 1.0, "Jr": 1.0, "com_x": 0.01}
ALONE = {
    "kt": (1.0, 0.05, "identified"),
    "kd": (1.0, 0.10, "identified"),
    "Jr": (1.0, 0.30, "weak"),
    "com_x": (0.01, 0.001, "identified"),
}


def world(**joint):
    calm = {name: (value, 10.0 * half, verdict) for name, (value, half, verdict) in ALONE.items()}
    return {
        "index": 7,
        "truth": TRUTH,
        "alone": [{"numbers": ALONE}, {"numbers": calm}, {"refused": "too-short"}],
        "joint": {"numbers": ALONE | joint},
    }


def test_a_joint_fit_as_good_as_its_best_flight_is_not_worse(assert_text):
    assert_text(report([world()])[-1])


def test_wider_and_lost_numbers_are_named():
    study = [world(kt=(1.0, 0.07, "identified"), Jr=(1.0, 5.0, "not-identified"))]
    text = "\n".join(report(study))
    assert "2 numbers of 1 worlds" in text
    assert "world 7: kt 1.4 times" in text
    assert "world 7: Jr lost" in text


def test_what_flights_have_for_themselves_may_be_wider():
    row = world(com_x=(0.01, 0.005, "identified"))
    assert not is_worse("com_x", 5.0, row)
    assert not is_worse("kt", 3.0, world(kt=(1.0, 0.015, "identified")))
    assert is_worse("kt", 3.0, world(kt=(1.0, 0.15, "identified")))


def test_an_interval_outside_the_truth_does_not_hold():
    (line,) = [x for x in report([world(kt=(1.2, 0.05, "identified"))]) if x.startswith("kt ")]
    assert line.split()[1:4] == ["0.00", "(", "1)"]


def test_a_refused_joint_fit_is_named(assert_text):
    row = world() | {"joint": {"refused": "impossible-size", "sentence": "too small"}}
    assert_text(report([row])[:2])
