"""The page in a real browser: no errors, zoom by mouse and keyboard, nothing leaves the page.

Needs the extra `browser` (playwright) and a Chromium of the system, such as Debian's package.
Screenshots and the printed page go to $ROTORFIT_SCREENSHOTS if it is set.
"""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from report_material import FOUND, a_comparison, a_result

from real_browser import opened_browser
from rotorfit.report.result_page import write_report


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    wanted = os.environ.get("ROTORFIT_SCREENSHOTS")
    path = Path(wanted) if wanted else tmp_path_factory.mktemp("browser")
    path.mkdir(parents=True, exist_ok=True)
    said = {"law": {"power": {"full_speed": 1234.567890, "offset": 0.0123, "exponent": 0.9}}}
    result = a_result(command_law=replace(FOUND, motors=said))
    flights = [a_comparison(), a_comparison(configuration="B", seed=2)]
    write_report(path / "report.html", result, comparisons=flights, paper=True, force=True)
    return path


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with opened_browser(tmp_path_factory.mktemp("profile"), width=1200, height=900) as context:
        yield context


@pytest.fixture
def page(browser: Any, folder: Path) -> Iterator[Any]:
    """The report, opened; what it complained of and asked for is in `page.met`."""
    page = browser.new_page()
    met: list[str] = []
    page.on("console", lambda message: met.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: met.append(f"error: {error}"))
    page.on("request", lambda request: met.append(f"request: {request.url}"))
    page.met = met
    page.goto((folder / "report.html").as_uri())
    yield page
    page.close()


def labels(page: Any) -> list[str]:
    return page.locator("figure.plot").first.locator(".x-ticks text").all_text_contents()


def curve(page: Any) -> str:
    return page.locator("figure.plot").first.locator(".curve.body").first.get_attribute("d")


def drag(page: Any, start: float, end: float, *, shift: bool = False) -> None:
    """Drag over the first figure, from one share of its width to another."""
    svg = page.locator("svg.wrench").first
    svg.scroll_into_view_if_needed()
    box = svg.bounding_box()
    y = box["y"] + 80
    if shift:
        page.keyboard.down("Shift")
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + end * box["width"], y, steps=4)
    page.mouse.up()
    if shift:
        page.keyboard.up("Shift")


def test_it_opens_without_a_complaint_and_asks_for_nothing(page: Any, folder: Path) -> None:
    assert page.met == [f"request: {(folder / 'report.html').as_uri()}"]
    assert page.locator(".tools:visible").count() == 3  # two flights, and what they excite


def test_dragging_zooms_and_double_click_resets(page: Any) -> None:
    before, line = labels(page), curve(page)
    assert before[0] == "0"
    drag(page, 0.3, 0.5)
    zoomed = labels(page)
    assert zoomed != before
    assert 10 < float(zoomed[0]) < float(zoomed[-1]) < 45
    assert curve(page) != line
    page.locator("svg.wrench").first.dblclick(position={"x": 300, "y": 80})
    assert labels(page) == before
    assert curve(page) == line


def test_shift_and_drag_pans(page: Any) -> None:
    drag(page, 0.4, 0.6)
    before = [float(label) for label in labels(page)]
    drag(page, 0.7, 0.4, shift=True)
    after = [float(label) for label in labels(page)]
    assert after[0] > before[0]
    assert after[1] - after[0] == pytest.approx(before[1] - before[0])


def test_the_keyboard_does_all_of_it(page: Any) -> None:
    before = labels(page)
    page.locator("svg.wrench").first.focus()
    page.keyboard.press("+")
    page.keyboard.press("+")
    zoomed = [float(label) for label in labels(page)]
    page.keyboard.press("ArrowRight")
    moved = [float(label) for label in labels(page)]
    assert moved[0] > zoomed[0]
    page.keyboard.press("-")
    page.keyboard.press("0")
    assert labels(page) == before


def test_buttons_zoom_one_flight_only(page: Any) -> None:
    second = page.locator("figure.plot").nth(1).locator(".x-ticks text")
    before = second.all_text_contents()
    page.get_by_role("button", name="Zoom in").first.click()
    assert labels(page) != before
    assert second.all_text_contents() == before


def test_pointing_reads_the_error(page: Any) -> None:
    svg = page.locator("svg.wrench").first
    svg.hover(position={"x": 300, "y": 80})
    words = page.locator(".readout").first.text_content()
    assert " s, error: Fz " in words
    assert "Mz" in words


def test_the_zoomed_curve_has_the_values_of_the_flight(page: Any) -> None:
    """Decoded in the page, the error's extremes are those of the comparison to a 16-bit step."""
    script = """() => {
      const data = JSON.parse(document.querySelector('figure.plot script').textContent);
      const packed = data.series['Fz error'];
      return [packed.low, packed.low + 65535 * packed.step];
    }"""
    low, high = page.evaluate(script)
    comparison = a_comparison()
    error = comparison.body_wrench[:, 2] - comparison.rotor_wrench[:, 2]
    assert low == pytest.approx(error.min())
    assert high == pytest.approx(error.max())


@pytest.mark.parametrize(("name", "width"), [("desktop", 1200), ("phone", 360)])
def test_it_fits_the_screen(page: Any, folder: Path, name: str, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    page.wait_for_timeout(200)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator(".heat .scroll").evaluate("e => e.scrollWidth - e.clientWidth") == 0
    view = page.locator("svg.wrench").first.get_attribute("viewBox").split()
    assert float(view[2]) <= width
    page.screenshot(path=folder / f"{name}.png", full_page=True)
    assert (folder / f"{name}.png").stat().st_size > 50_000


def test_it_prints(page: Any, folder: Path) -> None:
    printed = page.pdf(path=folder / "report.pdf", format="A4")
    assert printed[:5] == b"%PDF-"
    assert 4 <= printed.count(b"/Type /Page\n") <= 20


def test_an_injected_script_does_not_run(page: Any) -> None:
    page.evaluate(
        "() => { const s = document.createElement('script');"
        " s.textContent = 'window.ran = true'; document.body.append(s); }"
    )
    assert page.evaluate("window.ran") is None
    assert any("Content Security Policy" in line for line in page.met)
