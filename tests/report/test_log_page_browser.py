"""The pictures of a log in a real browser: values at the pointer, switches, zoom, the dark."""

from collections.abc import Iterator
from typing import Any

import pytest
from test_log_page import a_log

from real_browser import opened_browser
from rotorfit.report.log_page import write_log_page
from rotorfit.tools.inspection.inspect_log import inspect_log


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    path = tmp_path_factory.mktemp("log") / "log.html"
    write_log_page(path, [inspect_log(a_log())], force=False)
    profile = tmp_path_factory.mktemp("profile")
    with opened_browser(profile, width=1200, height=900) as browser:
        page = browser.new_page()
        met: list[str] = []
        page.on("console", lambda message: met.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: met.append(f"error: {error}"))
        page.on("request", lambda request: met.append(f"request: {request.url}"))
        page.met = met
        page.goto(path.as_uri())
        page.uri = path.as_uri()
        yield page


def chart(page: Any, number: int) -> Any:
    return page.locator("figure.plot").nth(number)


def test_it_opens_without_a_complaint_and_asks_for_nothing(page: Any) -> None:
    assert page.met == [f"request: {page.uri}"]


def test_the_pointer_reads_every_panel(page: Any) -> None:
    svg = chart(page, 0).locator("svg.chart")
    svg.hover(position={"x": 600, "y": 60})
    gyro, rotors, moved = svg.locator(".values").all_text_contents()
    assert gyro.startswith("x ") and "z " in gyro
    assert rotors == "1 11752 11753 11754 1175"  # rotor and speed, four times
    assert moved.startswith("roll ") and "yaw " in moved
    assert chart(page, 0).locator(".readout").text_content().endswith(" s")


def test_in_a_gap_there_is_nothing_to_read(page: Any) -> None:
    svg = chart(page, 0).locator("svg.chart")
    box = svg.bounding_box()
    x = 58 + (box["width"] - 68) * 7.25 / 20.0
    svg.hover(position={"x": x, "y": 60})
    gyro, rotors, _ = svg.locator(".values").all_text_contents()
    assert gyro == ""
    assert rotors.startswith("1 1175")


def test_a_curve_is_switched_off_and_on(page: Any) -> None:
    curve = chart(page, 0).locator('[data-key="gyro y"]')
    button = chart(page, 0).get_by_role("group", name="Gyro").get_by_role("button", name="y")
    drawn = curve.get_attribute("d")
    ticks = chart(page, 0).locator(".panel .y-ticks").first
    before = ticks.text_content()
    button.click()
    assert (curve.get_attribute("d"), button.get_attribute("aria-pressed")) == ("", "false")
    assert ticks.text_content() != before  # the panel's axis is that of what is left
    button.focus()
    page.keyboard.press("Enter")
    assert (curve.get_attribute("d"), button.get_attribute("aria-pressed")) == (drawn, "true")
    assert ticks.text_content() == before


def test_zooming_moves_marks_and_lines(page: Any) -> None:
    figure = chart(page, 1)
    line = figure.locator("svg.chart .line.notch path")
    before = float(line.get_attribute("d")[1:].split(" ")[0])
    figure.get_by_role("button", name="Zoom in").click()
    after = float(line.get_attribute("d")[1:].split(" ")[0])
    middle = 0.5 * (figure.locator(".frame").first.bounding_box()["width"] - 1.0)
    assert after - middle == pytest.approx(2.0 * (before - middle), abs=2.0)
    figure.get_by_role("button", name="whole").click()
    assert float(line.get_attribute("d")[1:].split(" ")[0]) == pytest.approx(before)


def test_it_fits_a_phone_and_follows_the_dark(page: Any) -> None:
    page.set_viewport_size({"width": 390, "height": 900})
    page.wait_for_timeout(100)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    ground = "getComputedStyle(document.body).backgroundColor"
    assert page.evaluate(ground) == "rgb(255, 255, 255)"
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(ground) == "rgb(20, 24, 30)"
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate(ground) == "rgb(255, 255, 255)"
