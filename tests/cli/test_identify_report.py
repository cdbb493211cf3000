"""rotorfit identify --report and --figures."""

import re
import sys

from kept_words import lines_with
from rotorfit.report.result_page import ALWAYS


def test_the_report_and_the_figures_are_written(run, here, assert_wording) -> None:
    ended = run("identify", "experiment.toml", "--report", "out.html", "--figures", "pictures")
    assert ended.code == 0, ended.err
    page = (here / "out.html").read_text()
    assert_wording(lines_with(page, "made the parameters"))
    assert str(here) not in page
    drawn = {path.name for path in (here / "pictures").glob("*.svg")}
    assert drawn >= {*ALWAYS, "center-top.svg", "wrench-1-A-flight.svg"}
    said = re.search(r"wrote (\d+) files to pictures", ended.err)
    assert said is not None
    assert int(said[1]) == len(list((here / "pictures").iterdir()))
    assert "wrote out.html" in ended.err


def test_without_the_renderer_one_line_names_it(run, here, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "resvg_py", None)
    ended = run("identify", "experiment.toml", "--figures", "pictures")
    assert ended.code == 0
    assert not list((here / "pictures").glob("*.png"))
    assert 'pip install "rotorfit[figures]"' in ended.err


def test_a_report_that_exists_is_refused_before_the_work(refused, here) -> None:
    (here / "out.html").write_text("mine")
    assert "out.html exists" in refused("identify", "experiment.toml", "--report", "out.html")
    assert (here / "out.html").read_text() == "mine"


def test_figures_that_exist_are_refused_before_the_work(refused, here) -> None:
    (here / "pictures").mkdir()
    (here / "pictures" / "vehicle-top.svg").write_text("mine")
    message = refused("identify", "experiment.toml", "--figures", "pictures")
    assert "already holds vehicle-top.svg" in message
    assert "--force" in message


def test_result_and_report_need_two_names(run, here) -> None:
    ended = run("identify", "experiment.toml", "-o", "out", "--report", "out")
    assert ended.code == 2
    assert "same file" in ended.err
    assert not (here / "out").exists()
