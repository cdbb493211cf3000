"""What results and logs show of themselves, in a terminal and in a notebook."""

import sys
from pathlib import Path

import numpy as np
import pytest

from rotorfit.errors import LogError, OutputError
from rotorfit.findings import doubt
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.sheet import LINES, WIDTH, Sheet, sheet_html, sheet_text

sys.path.append(str(Path(__file__).parents[1] / "report"))
from report_material import a_result


def a_log() -> FlightLog:
    slow, fast = np.arange(3) / 100.0, np.arange(5) / 200.0
    return FlightLog(
        path=Path("some/flight.bfl"),
        sha256="0" * 64,
        format="blackbox",
        channels={
            "gyro": Channel(time=fast, values=np.arange(15.0).reshape(5, 3), source="gyroADC"),
            "command": Channel(time=slow, values=np.ones((3, 4)), source="motor[0..3]"),
            "battery": Channel(time=slow, values=np.array([[16.0], [np.nan], [15.8]]), source="v"),
        },
        seconds=0.02,
        findings=(doubt("damaged-log", "3 frames were damaged"),),
    )


def test_a_result_fits_one_screen(assert_wording):
    text = str(a_result())
    lines = text.splitlines()
    assert len(lines) <= LINES and max(map(len, lines)) <= WIDTH
    assert lines[0].startswith("two payloads: ")
    assert any("kt " in line and "(3.630 +- 0.020)e-06 " in line for line in lines)
    assert_wording(lines)
    assert any(line.startswith("  kd ") and line.endswith("ratio-only") for line in lines)
    assert any(line.startswith("  Izz_com A") and line.endswith("not-identified") for line in lines)
    assert "print(rotorfit.result_text(result))" in text


def test_what_does_not_fit_is_counted():
    rows = [(f"kt_{i}", "1") for i in range(60)]
    lines = sheet_text(Sheet(heading="many", columns=("", "value"), rows=rows)).splitlines()
    assert len(lines) == LINES
    assert lines[-1] == "  ... and 39 more"
    assert sum(line.startswith("  kt_") for line in lines) + 39 == 60


def test_html_escapes_what_a_file_was_named():
    html = a_result(name="<script>x</script>")._repr_html_()
    assert "<script>" not in html and "&lt;script&gt;" in html
    assert html.count("<tr") == 1 + html.count('<tr title="')
    sheet = Sheet(heading="h", columns=("a",), rows=[("b",)], hints=['"c"'], remarks=("d & e",))
    assert "<li>d &amp; e</li>" in sheet_html(sheet) and "&quot;c&quot;" in sheet_html(sheet)


def test_a_log_shows_its_channels(assert_wording):
    text = str(a_log())
    assert text.startswith("flight.bfl: blackbox, 0.0 s\n")
    assert "5 " in text
    assert "200 Hz" in text
    assert_wording(text)
    assert "3 frames were damaged" in text
    assert "gyroADC" in a_log()._repr_html_()


def test_a_log_as_a_frame():
    pytest.importorskip("pandas", reason="pip install pandas")
    whole = a_log().to_frame()
    assert list(whole.columns) == [
        *("gyro_x", "gyro_y", "gyro_z"),
        *("command_1", "command_2", "command_3", "command_4", "battery"),
    ]
    assert len(whole) == 5 and whole.index.name == "time"
    assert whole["command_1"].notna().sum() == 3
    assert whole["gyro_y"].tolist() == [1.0, 4.0, 7.0, 10.0, 13.0]
    assert len(a_log().to_frame("battery")) == 3
    with pytest.raises(LogError, match=r"no channel 'accel'.*it has gyro, command, battery"):
        a_log().to_frame("accel")


def test_a_result_as_a_frame():
    pytest.importorskip("pandas", reason="pip install pandas")
    result = a_result()
    table = result.to_frame()
    assert len(table) == len(result.parameters) + len(result.derived)
    kt = table[table["name"] == "kt"].iloc[0]
    assert (kt["value"], kt["low"], kt["high"]) == (3.63e-6, 3.61e-6, 3.65e-6)
    about = table[(table["name"] == "Izz_com") & (table["configuration"] == "A")].iloc[0]
    assert about["verdict"] == "not-identified"


def test_without_pandas_a_frame_is_refused_in_words(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(OutputError, match=r"a frame needs pandas .*pip install pandas"):
        a_result().to_frame()


def test_a_notebook_shows_numbers_as_in_print(assert_wording):
    made = Sheet(
        heading="+- is half of it",
        columns=("", "value", "unit"),
        rows=(("kt", "(2.655 +- 0.063)e-07", "N s^2/rad^2"), ("a<b", "LOG_e-5", "1")),
    )
    html = sheet_html(made)
    assert "<strong>± is half of it" in html
    assert "(2.655 ± 0.063) ×" in html
    assert "10<sup>−7</sup>" in html
    assert_wording(html)
    assert "N s<sup>2</sup>/rad<sup>2</sup>" in html
    assert "a&lt;b" in html and "LOG_e-5" in html
