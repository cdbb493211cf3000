"""The page: complete, safe, small, quick, and in need of nothing outside itself."""

import dataclasses
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from report_material import ROTORS, UNKNOWN, a_comparison, a_result, parameter

from flown import with_findings
from kept_words import lines_with
from made_tables import judged
from rotorfit.digits import number_of
from rotorfit.errors import OutputError
from rotorfit.findings import Evidence, doubt
from rotorfit.report.parameters import parameter_tables
from rotorfit.report.result_page import report_html, write_report
from rotorfit.report.summary import summary_of
from rotorfit.results.result import IdentificationResult

HOSTILE = st.one_of(
    st.text(min_size=1, max_size=60),
    st.sampled_from(
        [
            "<script>alert(1)</script>",
            '"><img src=x onerror=alert(1)>',
            "</script><script>alert(1)//",
            "<!--",
            "]]>&lt;",
            "{{ 7*7 }}{% include 'page.html' %}",
            "\x00\x0b\ud800\u202e",
            "javascript:alert(1)",
        ]
    ),
)


class Page(HTMLParser):
    """Elements, text outside scripts and styles, and attributes of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.rows: list[list[str]] = []
        self._skip = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._skip = tag in ("script", "style")
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag: str) -> None:
        self._skip = False

    def handle_data(self, data: str) -> None:
        if not self._skip:
            self.words.append(data)
            if self.rows:
                self.rows[-1].append(data)

    @property
    def text(self) -> str:
        return " ".join(self.words)

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.elements)


def test_the_page_has_every_parameter_with_verdict_and_unit() -> None:
    result = a_result()
    page = Page(report_html(result))
    rows = [" ".join(" ".join(row).split()) for row in page.rows]
    for p in result.parameters:
        found = [row for row in rows if f" {p.name} " in f" {row} "]
        assert any(p.verdict in row for row in found), p.name
        if p.partner:
            assert any(f"{p.verdict} with {p.partner}" in row for row in found)
        number = number_of(p.value, p.interval)
        if number is not None:
            assert any(str(number) in row for row in found), p.name
    for word in (*(d.name for d in result.derived), "kg m²", "N s²/rad²"):
        assert word in page.text
    assert result.warnings[0] in page.text


def test_inertia_about_the_com_precedes_inertia_at_the_origin(assert_text) -> None:
    titles = [table.title for table in parameter_tables(a_result())]
    assert_text(titles)
    body = parameter_tables(a_result())[1]
    assert [row.name for row in body.rows][:5] == ["mass", "com_x", "com_y", "com_z", "Ixx_com"]


def test_the_summary_says_how_well_and_what_to_do(assert_wording) -> None:
    summary = summary_of(a_result())
    (title, body), _ = summary.groups
    lines = {line.heading: line for line in body}
    assert title == "Body, configuration A"
    com = lines["centre of mass [mm]"]
    assert [(p.words, p.shown, p.doubt) for p in com.parts] == [
        (way, "10.0 ± 1.0", "") for way in ("forward", "left", "up")
    ]
    assert com.remark == "from the origin"
    roll, _, yaw = lines["inertia [1e-2 kg m^2]"].parts
    assert (roll.words, roll.shown) == ("roll", "1.210 ± 0.020")
    assert (yaw.words, yaw.shown) == ("yaw", "not known")
    assert summary.next_step is not None
    assert "fly 20 s" in summary.next_step
    assert_wording(summary.next_step)


def test_counts_of_verdicts_are_those_of_the_result() -> None:
    result = a_result()
    for word, count, _ in summary_of(result).counts:
        assert count == sum(p.verdict == word for p in result.parameters) > 0


def test_no_number_is_nan_or_infinite() -> None:
    result = a_result()
    nan, inf = float("nan"), float("inf")
    odd = dataclasses.replace(
        result,
        parameters=(
            *result.parameters,
            parameter("motor_lag", None, value=nan, std=nan, interval=(nan, nan)),
            parameter("motor_delay", None, value=0.0, std=inf, interval=(-inf, inf)),
        ),
        covariance=result.covariance * nan,
        diagnostics={"excitation_roll": nan, "condition_roll": inf},
    )
    comparison = a_comparison(seconds=5)
    comparison.body_wrench[100:200] = nan
    comparison = dataclasses.replace(comparison, relative_error={"Fz": nan}, whiteness={"Fz": inf})
    html = report_html(odd, comparisons=[comparison], paper=True)
    html = html.replace("default-src 'none'", "")
    visible = re.sub(r'"data": "[^"]*"|"time": "[^"]*"|sha256-[^\']*', "", html)
    visible = re.sub(r"<style>.*?</style>|<script>.*?</script>", "", visible, flags=re.S)
    assert not re.search(r"\b(nan|inf|infinity|none)\b", visible, flags=re.I)
    assert "motor_delay" in html


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(name=HOSTILE, configuration=HOSTILE, file=HOSTILE, words=HOSTILE)
def test_hostile_names_stay_words(name: str, configuration: str, file: str, words: str) -> None:
    result = a_result(name=name, configurations=(configuration,), file=file, words=words)
    comparison = a_comparison(configuration=configuration, flight=file, seconds=0.2)
    plain = a_comparison(flight="plain", seconds=0.2)
    page = Page(report_html(result, comparisons=[comparison], paper=True))
    tame = Page(report_html(a_result(configurations=("A2",)), comparisons=[plain], paper=True))
    for tag in ("script", "style", "img", "iframe", "link", "form", "object", "meta"):
        assert page.count(tag) == tame.count(tag), tag
    for _, attributes in page.elements:
        assert not any(key.startswith("on") for key in attributes)
    page_bytes = report_html(result).encode()
    assert b"\x00" not in page_bytes


def test_nothing_points_outside() -> None:
    html = report_html(a_result(), comparisons=[a_comparison(seconds=2)], paper=True)
    assert not re.search(r"https?:", html)
    assert not re.search(r"\bsrc\s*=|@import|url\(", html)
    links = re.findall(r'href="([^"]*)"', html)
    anchors = set(re.findall(r'<section id="([^"]*)"', html))
    assert len(links) == 7
    assert all(link.startswith("#") and link[1:] in anchors for link in links)
    assert "default-src 'none'" in html


def test_folders_of_the_flights_stay_private() -> None:
    html = report_html(a_result(file="/home/someone/logs/A1.csv"))
    assert "someone" not in html
    assert "A1.csv" in html


def test_every_drawing_is_well_formed() -> None:
    html = report_html(a_result(), comparisons=[a_comparison(seconds=5)], paper=True)
    drawings = re.findall(r"<svg viewBox.*?</svg>(?=\s*<|\w)", html, flags=re.S)
    assert len(drawings) > 20
    body = html[html.index("<body>") :]
    for name in ("vehicle", "heat-map", "time-bar"):
        start = body.index(f'class="{name}"')
        opening = body.rindex("<svg", 0, start)
        ElementTree.fromstring(body[opening : body.index("</svg>", start) + 6])


def test_two_flights_make_a_small_page() -> None:
    comparisons = [a_comparison(seed=1), a_comparison(configuration="B", seed=2)]
    result = a_result()
    html = report_html(result, comparisons=comparisons, paper=True)
    assert len(html.encode()) < 3_000_000


def test_a_long_fast_flight_stays_small_too() -> None:
    html = report_html(a_result(), comparisons=[a_comparison(seconds=600, rate=1000)])
    assert len(html.encode()) < 1_500_000


def test_the_sections_and_their_order(assert_text) -> None:
    html = report_html(a_result(), comparisons=[a_comparison(seconds=2)], paper=True)
    assert re.findall(r'<section id="([^"]*)"', html) == [
        "summary", "parameters", "vehicle", "wrenches", "paper", "correlations", "flights",
        "provenance",
    ]  # fmt: skip
    titles = [re.sub(r"<[^>]*>", "", t) for t in re.findall(r"<h2.*?</h2>", html)]
    assert_text(titles)


def test_the_paper_stands_next_to_its_own_vehicle_only() -> None:
    result = a_result(configurations=("A",))
    assert 'id="paper"' in report_html(result)
    assert 'id="paper"' not in report_html(result, paper=False)
    other = a_result(configurations=("mine",))
    assert 'id="paper"' not in report_html(other)
    heavy = dataclasses.replace(
        result,
        parameters=tuple(
            dataclasses.replace(p, value=2.0) if p.name == "mass" else p for p in result.parameters
        ),
    )
    assert 'id="paper"' not in report_html(heavy)


def test_numbers_of_the_paper_are_shown_with_their_difference(assert_text, assert_wording) -> None:
    result = a_result(configurations=("A",))
    page = Page(report_html(result))
    rows = [" ".join(" ".join(row).split()) for row in page.rows]
    kt = next(row for row in rows if row.startswith("kt N s²/rad² 3.46"))
    assert_text(kt)
    assert any("B 4.40 % 20.99" in row for row in rows)
    assert any("% 10.70 % 45.19" in row for row in rows)
    assert_text(lines_with("\n".join(rows), "paper B alone"))
    assert_wording(lines_with(page.text, "legible"))


def test_without_vehicle_or_comparison_the_page_says_so() -> None:
    page = Page(report_html(a_result(settings={})))
    assert "do not describe a vehicle" in page.text
    assert "No flight was compared" in page.text
    assert page.count("svg") > 20


def test_what_no_flight_can_check_is_a_list_and_no_setting() -> None:
    rotors = [{"position": [0.1, 0.1, 0.0], "spin": "ccw"}]
    settings = {
        "airframe": {"rotors": rotors, "order": "px4", "axes": "FLU"},
        "used": {"band": "0 to 30 Hz", "hangs_on": ["kt is proportional to the mass"]},
    }
    text = " ".join(Page(report_html(a_result(settings=settings))).text.split())
    assert text.count("proportional to the mass") == 1
    assert "are right kt is" in text  # in the list below the settings
    assert "band = 0 to 30 Hz" in text and "airframe.axes FLU" in text
    assert "airframe.order" not in text


def test_a_result_that_knows_nothing_is_reported() -> None:
    nothing = a_result(
        parameters=(parameter("kt", None, **UNKNOWN, verdict="not-identified"),),
        derived=(), flights=(), covariance_names=(), covariance=a_result().covariance[:0, :0],
        findings=(), diagnostics={}, versions={},
    )  # fmt: skip
    page = Page(report_html(nothing))
    assert "not-identified" in page.text
    assert "0 flights" in page.text


def test_writing_refuses_to_replace(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(path, a_result())
    before = path.read_bytes()
    with pytest.raises(OutputError, match="is there already"):
        write_report(path, a_result(name="other"))
    assert path.read_bytes() == before
    write_report(path, a_result(name="other"), force=True)
    assert b"<h1>other</h1>" in path.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_the_report_of_a_saved_result_is_the_same(tmp_path: Path) -> None:
    result = a_result()
    result.save(tmp_path / "result.json")
    loaded = IdentificationResult.load(tmp_path / "result.json")
    assert report_html(loaded) == report_html(result)
    assert len(ROTORS) == 4


def test_a_component_that_cannot_be_predicted_is_not_drawn(assert_wording) -> None:
    whole = a_comparison(seconds=2)
    part = dataclasses.replace(
        whole, relative_error={k: v for k, v in whole.relative_error.items() if k != "Mz"}
    )
    html = report_html(a_result(), comparisons=[part])
    assert_wording(lines_with(html, "cannot be predicted"))
    assert 'data-key="Mx body"' in html
    assert "Mz body" not in html
    assert "Mz rotor" not in html


def test_error_norms_of_the_result_are_shown_without_figures() -> None:
    row = {"configuration": "A", "flight": "A2.csv", "relative_error": {"Fz": 0.0123, "Mx": None}}
    page = Page(report_html(a_result(validation=(row,))))
    rows = [" ".join(" ".join(row).split()) for row in page.rows]
    assert any(row.startswith("A2.csv A 1.2 % – – –") for row in rows)


def test_intervals_of_the_paper_are_said_to_be_its_own(assert_text) -> None:
    page = Page(report_html(a_result(method="tls")))
    assert "al. 2020), intervals" in page.text
    assert_text(lines_with(page.text, "by their formula"))
    assert "by their formula" not in Page(report_html(a_result())).text


def test_only_the_condition_of_rotors_and_bodies_is_judged(assert_wording) -> None:
    odd = {"condition": 1.26e3, "condition_bodies": 33.6}
    page = Page(report_html(dataclasses.replace(a_result(), diagnostics=odd))).text
    assert "parameters 1.26e+03, rotors" in page
    assert "bodies 33.6 (poor)." in page
    assert_wording(lines_with(page, "bodies 33.6"))
    assert "over 1000 doubtful" not in page


def test_nothing_is_flown_for_a_number_of_a_sensor() -> None:
    climb = "climb and sink: 20 s of gentle thrust steps"
    bias = parameter("accel_bias_x", "A", verdict="weak", reason="small", advice=climb)
    result = a_result()
    with_bias = dataclasses.replace(result, parameters=(*result.parameters, bias))
    notes = [note for table in parameter_tables(with_bias) for note in table.notes]
    assert [n.advice for n in notes if "accel_bias_x" in n.names] == [None]
    words = " ".join(Page(report_html(with_bias, comparisons=[])).text.split())
    assert climb not in words
    assert "known to ± 25 % or better" in words and "+-" not in words


def test_a_gap_that_is_short_is_not_said_to_last_no_time() -> None:
    result = a_result()
    cut = (22.1, 22.104, "gap in motor")
    flight = dataclasses.replace(result.flights[0], cuts=(cut,))
    html = report_html(dataclasses.replace(result, flights=(flight,)), comparisons=[])
    text = " ".join(Page(html).text.split())
    assert "under 0.1 s cut," in text and " cut, gap in motor" in text


def test_the_centre_of_mass_is_given_from_the_rotors_first() -> None:
    """Known to 4 mm from the IMU and far better from the rotors, by their correlation."""
    plain = a_result()
    com = next(d for d in plain.derived if d.full_name == "com_x@A")
    com = replace(com, value=0.011, std=0.003)
    msx = next(p for p in plain.parameters if p.full_name == "msx@A")
    center = replace(msx, name="rotor_center_x", value=0.010, std=0.004, unit="m")
    made = replace(
        plain,
        parameters=(*plain.parameters, center),
        derived=tuple(com if d.full_name == "com_x@A" else d for d in plain.derived),
        covariance_names=("msx@A", "rotor_center_x@A"),
        covariance=np.array([[4.0, 0.9 * 8.0], [0.9 * 8.0, 16.0]]),
    )
    (_, body), _ = summary_of(made).groups
    headings = [line.heading for line in body]
    assert headings.index("centre of mass [mm]") + 1 == headings.index("the same [mm]")
    line = body[headings.index("centre of mass [mm]")]
    assert line.remark == "from the rotors' centre"
    [part] = line.parts
    assert part.value == pytest.approx(1.0)
    assert part.interval is not None
    half = 1.96 * np.sqrt(3.0**2 + 4.0**2 - 2 * 0.9 * 3.0 * 4.0)
    assert part.interval[1] - part.value == pytest.approx(half)


def test_a_note_in_short_keeps_what_its_flight_shows() -> None:
    """The name of the flight before it is no finding."""
    about = "a-very-long-name-of-a-flight.mcap: the gyro is at the end of its range for 1 %"
    found = doubt("sensor-saturated", f"{about}: what is faster is cut off; set a wider range")
    assert summary_of(with_findings(a_result(), found)).notes[-1] == about


def test_two_estimates_that_differ_are_told_with_how_far() -> None:
    found = replace(
        doubt("thrust-against-weight", "", numbers=("Ixx_com",), doubtful_because="two differ"),
        evidence=(Evidence(name="thrust_over_weight", value=0.68),),
    )
    summary = summary_of(judged(with_findings(a_result(), found)))
    assert summary.doubts == ("inertia may be outside its interval: two differ by 32 %",)
