"""`rotorfit why` and `identify --why`: the uncertainty budget on the command line."""

import json

import pytest


@pytest.fixture(scope="module")
def saved(tmp_path_factory, simulated):
    """Identify a flight, and return its result file."""
    import flown

    folder = tmp_path_factory.mktemp("why")
    result = flown.identified(folder, [simulated])
    path = folder / "result.json"
    result.save(path)
    return path


def budget(run, *arguments):
    ended = run(*arguments, "--json")
    assert (ended.code, ended.err.replace("wrote result.json\n", "")) == (0, "")
    return json.loads(ended.out)


def test_a_budget_lists_the_largest_contribution_first(run, saved):
    [found] = budget(run, "why", saved, "Ixx")
    sizes = [term["half_width"] for term in found["terms"]]
    assert sizes[0] == max(sizes)
    assert sum(term["share"] for term in found["terms"]) == pytest.approx(1.0)
    assert found["half_width"] == pytest.approx(sum(s**2 for s in sizes) ** 0.5)
    assert all(term["action"] and term["source"] for term in found["terms"])
    text = run("why", saved, "Ixx").out
    names = [line.split("  ")[1] for line in text.splitlines()[1:] if line.endswith("#")]
    assert names[0] == found["terms"][0]["name"]


def test_without_a_number_the_main_ones_have_a_line_each(run, saved):
    ended = run("why", saved)
    assert ended.code == 0
    starts = {line.split(" ")[0] for line in ended.out.splitlines() if ": " in line}
    assert {"kt", "kd", "Ixx_com@A", "Iyy_com@A", "Izz_com@A"} <= starts
    every = budget(run, "why", saved)
    assert {"kt", "Ixx", "com_x"} <= {one["name"] for one in every}


def test_a_number_before_its_result_is_put_right(run, saved):
    ended = run("why", "Ixx", saved)
    assert ended.code == 2
    assert f"rotorfit why {saved} Ixx" in " ".join(ended.err.split())


def test_an_unknown_number_is_refused(run, saved):
    ended = run("why", saved, "Ixxx")
    assert (ended.code, ended.out) == (1, "")
    assert "did you mean Ixx" in ended.err


def test_an_older_file_says_that_it_has_no_budget(run, saved, tmp_path):
    plain = json.loads(saved.read_text(encoding="utf-8"))
    plain["schema"] = 1
    for one in (*plain["parameters"], *plain["derived"]):
        del one["interval_terms"]
    path = tmp_path / "old.json"
    path.write_text(json.dumps(plain), encoding="utf-8")
    ended = run("why", path, "kt")
    assert ended.code == 0
    assert budget(run, "why", path, "kt")[0]["terms"] == []


def test_identify_says_the_same_as_why(run, here):
    identified = budget(run, "identify", "experiment.toml", "-o", "result.json", "--why", "Ixx")
    assert identified == budget(run, "why", "result.json", "Ixx")
