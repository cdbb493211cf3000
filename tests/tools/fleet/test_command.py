"""rotorfit fleet: what it leaves, what it says, and what it refuses."""

import csv
import html
import io
import re
import shlex
import shutil

import pytest
from benchmarks.common import without_progress

from kept_words import lines_with
from rotorfit.cli.main import main
from rotorfit.tools.fleet.run import Workers, claim
from rotorfit.tools.fleet.tables import csv_bytes


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command in this process, without any other."""

    def alone(count, scheduler, time_limit):
        return Workers(count=0, time_limit=time_limit)

    monkeypatch.setattr("rotorfit.tools.fleet.run.Workers", alone)

    def called(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(["fleet", *map(str, arguments)])
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, without_progress(printed.err)

    return called


@pytest.fixture
def out(small_fleet, tmp_path):
    """A folder of the fleet, its logs identified before."""
    folder = tmp_path / "out"
    claim(folder, small_fleet.folder, force=False)
    shutil.copytree(small_fleet.cache, folder / "cache")
    return folder


def declared(small_fleet):
    return "--airframe", small_fleet.defaults.airframe, "--mass", small_fleet.defaults.mass


def test_tables_and_page_of_a_fleet(run, out, small_fleet, assert_wording, assert_text):
    code, said, _ = run(small_fleet.folder, *declared(small_fleet), "-o", out)
    assert code == 0
    assert "4 flights" in said
    assert "of 2 vehicles" in said
    assert_wording(said)
    assert "3 logs" in said
    assert f"in {out / 'failures.csv'}" in said
    parquet = pytest.importorskip("pyarrow.parquet")
    flights = parquet.read_table(out / "flights.parquet").to_pylist()
    assert [f["file"] for f in flights] == [r.file for r in small_fleet.fleet.records]
    first = small_fleet.fleet.records[0]
    assert flights[0]["kt"] == first.value("kt")
    assert flights[0]["kt_low"] < flights[0]["kt"] < flights[0]["kt_high"]
    assert flights[0]["kt_verdict"] == "identified"
    vehicles = parquet.read_table(out / "vehicles.parquet").to_pylist()
    assert [(v["vehicle"], v["flights"]) for v in vehicles] == [("one", 2), ("two", 2)]
    own = [r.value("kt") for r in small_fleet.fleet.records[:2]]
    assert min(own) < vehicles[0]["kt_joint"] < max(own)
    failures = list(csv.DictReader(io.StringIO((out / "failures.csv").read_text("utf-8"))))
    assert [f["log"] for f in failures] == [f.file for f in small_fleet.fleet.refused]
    page = (out / "fleet.html").read_text("utf-8")
    assert "identify one/flight1.csv --mass 1.285" in page
    assert_text(lines_with(page, "one/flight1.csv --mass"))


def test_a_flights_command_makes_the_report_the_next_run_links(
    run, out, small_fleet, monkeypatch, capsys
):
    asked = (small_fleet.folder, *declared(small_fleet), "-o", out)
    run(*asked)
    page = html.unescape((out / "fleet.html").read_text("utf-8"))
    (line,) = re.findall(r"rotorfit identify one/flight2\.csv [^<]*", page)
    monkeypatch.chdir(small_fleet.folder)
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(line)[1:])
    capsys.readouterr()
    assert not ended.value.code
    (report,) = (out / "reports").iterdir()
    assert "flight2.csv" in report.read_text("utf-8")
    assert 'href="reports/' not in page
    run(*asked)
    again = (out / "fleet.html").read_text("utf-8")
    assert again.count(f'<a href="reports/{report.name}">open</a>') == again.count('href="rep') == 1


def test_without_pyarrow_the_tables_are_csv(run, out, small_fleet, monkeypatch, assert_wording):
    monkeypatch.setattr("rotorfit.tools.fleet.tables.find_spec", lambda name: None)
    code, _, err = run(small_fleet.folder, *declared(small_fleet), "-o", out, "--json")
    assert code == 0
    assert_wording(err)
    rows = list(csv.DictReader(io.StringIO((out / "flights.csv").read_text("utf-8"))))
    assert float(rows[0]["kt"]) == small_fleet.fleet.records[0].value("kt")


def test_a_fleet_without_a_single_flight_says_why(run, tmp_path, small_fleet, assert_wording):
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "a.bfl").write_bytes(b"")
    code, _, err = run(logs, *declared(small_fleet), "-o", tmp_path / "out")
    assert code == 1
    assert "of 1 logs" in err
    assert_wording(err)
    assert "is empty (0 bytes)" in err
    assert (tmp_path / "out" / "failures.csv").exists()


def test_stopped_it_says_how_to_go_on(run, out, small_fleet, monkeypatch, assert_wording):
    def stopped(logs, cache, workers, *, progress):
        raise KeyboardInterrupt

    monkeypatch.setattr("rotorfit.tools.fleet.run.read_fleet", stopped)
    code, _, err = run(small_fleet.folder, *declared(small_fleet), "-o", out)
    assert code == 130
    assert "0 of 7 logs" in err
    assert_wording(err)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--vehicle-of", "("), 2, "is no regular expression"),
        (("--mass", "heavy"), 2, "'heavy' is not a mass; give kilograms"),
        (("--mass", "428"), 1, "did you mean 428 g? Then give --mass 428g"),
        (("--time-limit", "0"), 2, "--time-limit"),
    ],
)
def test_wrong_options_are_refused(run, tmp_path, small_fleet, arguments, code, words):
    ended, _, err = run(small_fleet.folder, *arguments, "-o", tmp_path / "out")
    assert (ended, words in " ".join(err.split())) == (code, True)
    assert not (tmp_path / "out").exists()


def test_numbers_of_a_csv_keep_all_their_digits():
    assert csv_bytes([{"a": [0.1 + 0.2], "b": [None]}]) == b"a,b\n0.30000000000000004,\n"
