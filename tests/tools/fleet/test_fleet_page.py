"""The fleet's page: needs nothing else, says what is to be looked at, stays small."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from fleet_material import DAY, KT, START, STD, a_fleet, a_record, planted_fleet

from kept_words import lines_with
from rotorfit.report.fleet_page import MOST_ROWS, Links, fleet_html, report_command
from rotorfit.tools.fleet.records import KT_WEIGHT, RefusedLog, refusal
from rotorfit.tools.fleet.statistics import fleet_statistics


@pytest.fixture(scope="module")
def html() -> str:
    records, statistics = planted_fleet()
    why = refusal("not-identified", "cut <off>", "copy it again")
    refused = [RefusedLog(file=f"/logs/x{i}.ulg", refusal=why) for i in range(3)]
    links = Links(
        report=lambda record: "reports/V01-log1.html" if record is records[0] else "",
        command=report_command,
    )
    return fleet_html(statistics, records, refused, name="Line <3>", links=links)


class Tags(HTMLParser):
    """Whether every element is closed, and what it refers to."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.addresses += [v or "" for k, v in attrs if k in ("href", "src", "xlink:href")]
        if tag not in ("meta", "br", "link"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_it_is_whole_and_needs_nothing_else(html):
    tags = Tags()
    tags.feed(html)
    assert tags.open == []
    assert all(a.startswith("#") or a == "reports/V01-log1.html" for a in tags.addresses)
    assert "http" not in html.replace('http-equiv="Content', "")
    assert "nan" not in re.sub(r"<script>.*</script>", "", html, flags=re.S).lower().split()


def test_names_are_text(html):
    assert "Line &lt;3&gt;" in html
    assert "cut &lt;off&gt;" in html
    assert "/logs/" not in html  # folders are nobody's business


def test_findings_come_first_with_what_to_check(html, assert_wording):
    first = html[: html.index('id="type"')]
    assert first.count('class="find ') == 3
    assert "rotor 2 falls" in first
    assert "propeller 2" in first
    assert "in 5 of 100" in first
    assert_wording(lines_with(first, "rotor 2 falls"))
    assert_wording(lines_with(first, "propeller 2"))
    assert_wording(lines_with(first, "False alarms"))


def test_every_flight_has_its_report_or_its_command(html, assert_text):
    assert '<a href="reports/V01-log1.html">open</a>' in html
    assert html.count("rotorfit identify V") == 95
    assert "identify V02/log5.ulg --mass 1.4" in html
    assert_text(lines_with(html, "V02/log5.ulg --mass"))


def test_vehicles_can_be_sorted_and_changes_are_marked(html):
    table = html[html.index('class="vehicles sortable"') :]
    assert table.count("<button") == 3 + 3
    assert 'data-key="V02"' in table
    assert html.count('<figure class="changed">') == 3  # rotor 2 and all rotors of one, the battery


def test_a_quiet_fleet_says_so(assert_wording):
    records = a_fleet(seed=1, vehicles=5, flights=4)
    assert_wording(
        lines_with(fleet_html(fleet_statistics(records), records), "No change was found")
    )


@pytest.mark.parametrize(("flights", "said"), [(3, "nothing to compare yet"), (5, "No change")])
def test_one_vehicle_has_no_column_of_dashes(flights, said, assert_wording):
    records = a_fleet(seed=1, vehicles=1, flights=flights)
    page = fleet_html(fleet_statistics(records), records)
    assert said in page
    assert ("False alarms" in page) is (flights > 3)
    assert "takes 5 vehicles" in page
    assert_wording(lines_with(page, "takes 5 vehicles"))
    kept = page[
        page.index('<table class="fleet-type">') : page.index('aria-labelledby="over-time"')
    ]
    assert "Mean ±" not in kept and "Between vehicles" not in kept
    assert "Between flights" in kept and ">–<" not in kept


@pytest.mark.slow
def test_many_flights_are_averaged_in_drawings_and_not_listed():
    rng = np.random.default_rng(4)
    records = [
        a_record({KT_WEIGHT: KT + STD[KT_WEIGHT] * x}, file=f"log{i}.ulg", started=START + DAY * i)
        for i, x in enumerate(rng.standard_normal(2 * (MOST_ROWS + 1)))
    ]
    few, many = (
        fleet_html(fleet_statistics(part), part) for part in (records[: MOST_ROWS + 1], records)
    )
    assert len(many) < 1.3 * len(few)
    assert f"{len(records)} more flights are in" in many


def test_no_flight_at_all():
    assert "0 vehicles, 0 flights" in fleet_html(fleet_statistics([]), [])
