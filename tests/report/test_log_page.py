"""The page of inspect: its pictures with the numbers that were planted, and none without."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kept_words import lines_with
from rotorfit.findings import doubt
from rotorfit.logs.firmware import Filter
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.report.log_page import log_report_html
from rotorfit.tools.inspection.inspect_log import LogReport, inspect_log

RATE, SECONDS = 500.0, 20.0
NOTCH = {"gyro_notch_hz": "120", "gyro_notch_cutoff": "100", "gyro_lpf1_static_hz": "200"}


def a_log(**left_out: object) -> FlightLog:
    """A hover with rotors at 187 Hz that shake the gyro, a gap at 7 s, and no accelerometer."""
    t = np.arange(round(RATE * SECONDS)) / RATE
    gyro = 0.02 * np.random.default_rng(5).normal(size=(len(t), 3))
    gyro[:, 1] += 0.1 * np.sin(2 * np.pi * 187.0 * t)
    kept = (t < 7.0) | (t >= 7.5)
    channels = {
        "gyro": Channel(time=t[kept], values=gyro[kept], source="gyroADC"),
        "rotor_speed": Channel(
            time=t, values=np.full((len(t), 4), 2 * np.pi * 187.0), source="eRPM"
        ),
    }
    return FlightLog(
        path=Path("made.bfl"),
        sha256="0" * 64,
        format="blackbox",
        channels={name: c for name, c in channels.items() if name not in left_out},
        seconds=SECONDS,
        metadata=NOTCH,
    )


@pytest.fixture(scope="module")
def report() -> LogReport:
    return inspect_log(a_log())


@pytest.fixture(scope="module")
def html(report: LogReport) -> str:
    return log_report_html(report)


def places(html: str, style: str) -> list[float]:
    found = re.findall(rf'<g class="(?:line|span) {style}" data-(?:at|from)="([^"]+)"', html)
    return [float(value) for value in found]


def test_peak_filters_and_rotors_stand_at_their_frequencies(html: str, assert_text) -> None:
    assert_text(lines_with(html, "1st rotor harmonic"))
    assert places(html, "peak") == [pytest.approx(187.0, abs=0.6)]
    assert places(html, "low-pass") == [200.0]
    assert sorted(places(html, "notch")) == [100.0, 120.0]
    assert places(html, "harmonic") == [187.0, 187.0]  # the stretch, and its name


def test_the_gap_stands_at_its_seconds_and_is_said(html: str, assert_text) -> None:
    assert places(html, "gap") == [pytest.approx(6.998)]
    assert "over time. Gap in the gyro: 7.00 to 7.50 s." in html
    assert_text(lines_with(html, "Gap in the gyro"))


def test_what_is_not_there_is_said_and_not_drawn(html: str, assert_wording) -> None:
    assert_wording(lines_with(html, "Not drawn"))
    assert 'data-key="accel' not in html
    pose = Channel(time=np.arange(99) / 9.0, values=np.ones((99, 3)), source="TUM")
    log = FlightLog(
        path=Path("take.tum"), sha256="", format="trajectory", channels={"position": pose},
        seconds=11.0,
    )  # fmt: skip
    page = log_report_html(inspect_log(log))
    assert 'data-key="position z"' in page
    assert "spectra" not in re.findall(r'<svg [^>]*class="chart (\w+)"', page)


def test_the_page_holds_what_it_redraws_and_nothing_else(html: str) -> None:
    figures = re.findall(r'<script type="application/json">(.*?)</script>', html)
    assert len(figures) == 2
    drawn = set(re.findall(r'data-key="([^"]+)"', html))
    kept = {key for figure in figures for key in json.loads(figure)["series"]}
    assert drawn < kept
    assert kept - drawn == {"roll moved", "pitch moved", "yaw moved"}  # strips
    assert "http" not in html.replace("http-equiv", "")
    assert len(re.findall(r"<script>", html)) == 1


def test_names_from_a_log_cannot_become_elements(assert_wording) -> None:
    log = a_log(rotor_speed=None)
    said = {**NOTCH, "Craft name": "<script>alert(1)</script>"}
    evil = FlightLog(
        path=Path("<b>.bfl"), sha256="", format="blackbox", channels=log.channels,
        seconds=SECONDS, metadata=said, notes=("<img src=x>",),
    )  # fmt: skip
    page = log_report_html(inspect_log(evil))
    assert "<b>" not in page and "<img" not in page and "alert(1)</script>" not in page
    assert_wording(lines_with(page, "matched to the rotors"))


def test_a_page_of_two_logs_has_both(report: LogReport) -> None:
    page = log_report_html(report, report)
    assert page.count("<h1>made.bfl</h1>") == 2
    assert page.count('<figure class="plot">') == 4


def test_a_filter_that_moves_is_drawn_where_it_can_be(report: LogReport) -> None:
    assert report.pictures is not None
    moving = Filter(
        channel="gyro", kind="notch", low=100.0, high=600.0, setting="dyn_notch", passed=True
    )
    rotors = replace(moving, low=60.0, high=60.0, harmonics=(1, 2))
    pictures = replace(report.pictures, filters=(moving, rotors))
    html = log_report_html(replace(report, pictures=pictures))
    assert re.findall(r'class="span moving" data-from="100" data-to="(\d+)"', html) == ["600"]
    # At one time the rotors' frequency; twice that is beyond half of 500 Hz.
    assert re.findall(r'<g class="span notch" data-from="(\d+)" data-to="(\d+)"', html) == [
        ("187", "187")
    ]


def test_a_page_of_a_log_writes_plus_minus_as_a_sign(report: LogReport) -> None:
    seen = doubt("gravity", "it reads 1.00 +- 0.02 g")
    noted = replace(report, findings=(*report.findings, seen))
    assert "it reads 1.00 ±  0.02 g" in log_report_html(noted)
