"""The page in a real browser, as a person uses it: from a dropped log to files of other tools.

One browser, one server and one identification for all. `pytest --update-pictures
tests/app/test_page.py` writes the pictures of the documentation anew.
"""

import base64
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from benchmarks.page_stopwatch import served

from real_browser import opened_browser
from rotorfit.digits import number_of
from rotorfit.errors import LogError
from rotorfit.logs import read_log
from rotorfit.model.vehicle import Vehicle, layout_rotors
from rotorfit.simulation import Scenario, layout_vehicle, simulate_flight, write_flight_table
from rotorfit.simulation.experiment_files import experiment_text, table_text
from rotorfit.simulation.experiments import fly, plan_experiment, planned_flights

expect = pytest.importorskip(
    "playwright.sync_api", reason='needs a browser driver: pip install "rotorfit[browser]"'
).expect
pytest.importorskip("starlette", reason='needs the server: pip install "rotorfit[app]"')
pytest.importorskip("uvicorn", reason='needs the server: pip install "rotorfit[app]"')

WIDTH, HEIGHT = 1100, 900
PATIENCE = 120_000
"""With a browser and a server on a busy machine [ms]."""
PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
DROP = """([name, text]) => {
  const data = new DataTransfer();
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  data.items.add(new File([bytes], name));
  for (const kind of ['dragover', 'drop']) {
    document.getElementById('drop').dispatchEvent(
      new DragEvent(kind, { dataTransfer: data, bubbles: true, cancelable: true }));
  }
}"""
VALUES = """() => Object.fromEntries([...document.querySelectorAll('tr[data-value]')].map(
  (row) => [row.dataset.name, [row.dataset.value, row.querySelector('.number').textContent]]))"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """A log of a quad-x in Betaflight's order, and what a ruler and a scale say [mm, g]."""

    path: Path
    spacing: tuple[str, str]
    mass: str


@pytest.fixture(scope="module")
def flown_log(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Flown:
    """A real flight; a simulated one where there are no real ones."""
    try:
        real = request.getfixturevalue("flight_data_dir") / "tudelft-indiflight" / "LOG00267.BFL"
    except pytest.skip.Exception:
        real = Path("absent")
    if real.is_file():
        return Flown(path=real, spacing=("91", "127"), mass="428")
    truth, _ = layout_vehicle("quad-x")
    rotors = layout_rotors("quad-x", arm=0.2, order="betaflight")
    flight = simulate_flight(truth, Vehicle(rotors=rotors), Scenario(seconds=20.0), seed=1)
    path = tmp_path_factory.mktemp("flown") / "flight.csv"
    write_flight_table(flight, path)
    return Flown(path=path, spacing=("282.842712", "282.842712"), mass="1400")


@dataclass(frozen=True, slots=True)
class Seen:
    """What the pages complained of, and which other computers they asked for anything."""

    complaints: list[str]
    foreign: list[str]


@pytest.fixture(scope="module")
def seen() -> Seen:
    return Seen([], [])


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory, seen: Seen) -> Iterator[Any]:
    def guard(route: Any) -> None:
        address = urlsplit(route.request.url)
        if address.scheme in ("blob", "data") or address.hostname == "127.0.0.1":
            route.continue_()
            return
        seen.foreign.append(route.request.url)
        route.abort()

    profile = tmp_path_factory.mktemp("profile")
    with opened_browser(profile, width=WIDTH, height=HEIGHT) as context:
        context.set_default_timeout(PATIENCE)
        context.route("**/*", guard)
        yield context


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The page's address, as the command prints it."""
    with served() as printed:
        yield printed


def opened(browser: Any, address: str, seen: Seen) -> Any:
    page = browser.new_page()
    page.on(
        "console",
        lambda m: seen.complaints.append(m.text) if m.type in ("error", "warning") else None,
    )
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    page.goto(address)
    page.wait_for_selector("html[data-ready]")
    return page


@pytest.fixture
def page(browser: Any, address: str, seen: Seen) -> Iterator[Any]:
    """A page on which nothing was done yet."""
    page = opened(browser, address, seen)
    yield page
    page.close()


@pytest.fixture(scope="module")
def work(browser: Any, address: str, seen: Seen, flown_log: Flown) -> Any:
    """A page on which a dropped log was identified."""
    page = opened(browser, address, seen)
    drop(page, flown_log.path.name, flown_log.path.read_bytes())
    page.wait_for_selector(".file .section")
    page.select_option("#layout", "quad-x")
    page.select_option("#order", "betaflight")
    page.get_by_label("Two distances").check()
    fill(page, "#size-0", flown_log.spacing[0])
    fill(page, "#size-1", flown_log.spacing[1])
    fill(page, "#mass-0", flown_log.mass)
    page.click("#identify")
    page.wait_for_selector("#stop")
    page.wait_for_selector("tr[data-name=kt]")
    return page


def drop(page: Any, name: str, content: bytes) -> None:
    page.evaluate(DROP, [name, base64.b64encode(content).decode()])


def fill(page: Any, field: str, text: str) -> None:
    page.fill(field, text)
    page.keyboard.press("Tab")


def downloaded(page: Any, button: str, folder: Path) -> Path:
    with page.expect_download() as caught:
        page.get_by_role("button", name=button, exact=True).click()
    path = folder / caught.value.suggested_filename
    caught.value.save_as(path)
    return path


def exported(page: Any, target: str, folder: Path, **assumed: str) -> Path:
    """Download the file of another tool, what it asks for being assumed."""
    page.select_option("#target", target)
    if assumed:
        page.click("#export")
    for name, value in assumed.items():
        page.fill(f"#assume-{name}", value)
    with page.expect_download() as caught:
        page.click("#export")
    path = folder / caught.value.suggested_filename
    caught.value.save_as(path)
    return path


def expect_spins(page: Any, *spins: str) -> None:
    expect(page.locator(".rotor-spin")).to_have_text(list(spins))


def test_the_page_says_what_the_command_line_says(
    work: Any, flown_log: Flown, tmp_path: Path
) -> None:
    """The experiment file written by the page gives the same numbers, to the last digit."""
    experiment = downloaded(work, "Download the experiment file", tmp_path)
    (tmp_path / flown_log.path.name).symlink_to(flown_log.path)
    result = tmp_path / "by-command.json"
    command = [sys.executable, "-m", "rotorfit", "identify", str(experiment), "-o", str(result)]
    subprocess.run(command, check=True, capture_output=True)
    said = json.loads(result.read_text())
    numbers = [p for p in (*said["parameters"], *said["derived"]) if p["value"] is not None]
    shown = work.evaluate(VALUES)
    assert len(numbers) > 20
    for number in numbers:
        value, words = shown[number["name"]]
        assert float(value) == number["value"], number["name"]
        interval = number["interval"] and tuple(number["interval"])
        assert words == str(number_of(number["value"], interval))
    assert 0.1e-7 < float(shown["kt"][0]) < 1e-5


def test_the_report_is_shown_and_downloaded(work: Any, browser: Any, tmp_path: Path) -> None:
    shown = work.inner_text("tr[data-name=kt] .number")
    work.get_by_role("button", name="Show it here").click()
    framed = work.frame_locator("iframe.report").locator("tr[data-name=kt] .number")
    assert framed.inner_text() == shown
    work.get_by_role("button", name="Show it here").click()
    report = downloaded(work, "Report (HTML)", tmp_path)
    assert report.name == "report.html"
    assert shown in report.read_text(encoding="utf-8")
    result = json.loads(downloaded(work, "Result (JSON)", tmp_path).read_text())
    assert result["parameters"][0]["value"] == float(work.evaluate(VALUES)["kt"][0])


def test_the_parts_of_an_interval_are_stacked(work: Any) -> None:
    work.get_by_text("Where the intervals come from").click()
    bars = work.locator("tr[data-budget=kt] svg.budget rect")
    widths = [float(bars.nth(i).get_attribute("width")) for i in range(bars.count())]
    assert sum(widths) == pytest.approx(260.0, abs=0.1)
    assert widths[0] == max(widths)


def test_the_mjcf_is_the_identified_vehicle(work: Any, flown_log: Flown, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo to load its file")
    # A log without commands tells neither the motors' lag nor their full speed: asked for.
    asked = {"motor_lag": "0.03", "max_speed": "1500"} if flown_log.path.suffix == ".csv" else {}
    path = exported(work, "mujoco", tmp_path, **asked)
    model = mujoco.MjModel.from_xml_path(str(path))
    assert sum(model.body_mass) == pytest.approx(1e-3 * float(flown_log.mass))
    assert model.nu == 4


def test_a_reload_keeps_the_work(work: Any, flown_log: Flown) -> None:
    before = work.evaluate(VALUES)
    work.reload()
    work.wait_for_selector("html[data-ready]")
    work.wait_for_selector("tr[data-name=kt]")
    assert work.evaluate(VALUES) == before
    assert work.input_value("#mass-0") == flown_log.mass
    assert (work.input_value("#size-0"), work.input_value("#size-1")) == flown_log.spacing
    assert work.locator(".file h3").all_text_contents() == [flown_log.path.name]
    expect_spins(work, "cw", "ccw", "ccw", "cw")


def test_a_loop_that_is_not_judged_is_one_sentence(work: Any) -> None:
    heading = work.get_by_role("heading", name="Is it tuned well?")
    words = heading.locator("xpath=following-sibling::p[1]").inner_text()
    assert words.startswith("Not judged: ")
    assert work.locator("iframe[title='Margins of the rate loops']").count() == 0


def test_it_fits_a_phone(work: Any) -> None:
    work.set_viewport_size({"width": 390, "height": 844})
    work.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert work.evaluate("document.documentElement.scrollWidth") == 390
    work.set_viewport_size({"width": WIDTH, "height": HEIGHT})


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everybody_can_use_it(work: Any, scheme: str) -> None:
    """The rules of axe-core: names, roles, contrast, order of headings."""
    assert violations(work, scheme) == []


def violations(page: Any, scheme: str) -> list[tuple[str, str]]:
    package = pytest.importorskip("axe_playwright_python", reason="needs axe-core")
    page.emulate_media(color_scheme=scheme)
    page.evaluate((files(package) / "axe.min.js").read_text(encoding="utf-8"))
    rules = "runOnly: ['color-contrast']" if scheme == "dark" else ""
    found = page.evaluate(f"axe.run({{ {rules} }})")["violations"]
    page.emulate_media(color_scheme="light")
    return [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] != "minor"]


def test_motors_are_reversed_swapped_and_turned(page: Any) -> None:
    page.select_option("#order", "px4")
    expect_spins(page, "ccw", "ccw", "cw", "cw")
    page.click("#motor-3")
    expect_spins(page, "ccw", "ccw", "ccw", "cw")
    page.get_by_role("button", name="Reverse all spins").click()
    expect_spins(page, "cw", "cw", "cw", "ccw")
    before = page.locator("#motor-1 .disc").bounding_box()
    page.get_by_role("button", name="Swap two numbers").click()
    page.click("#motor-1")
    page.click("#motor-2")
    page.wait_for_selector("#motor-2[aria-label^='Motor 2, front right, turns']")
    assert page.locator("#motor-2 .disc").bounding_box() == before
    for _ in range(2):
        page.get_by_role("button", name="Turn the drawing to the right").click()
    page.wait_for_selector(".front > g[transform^='rotate(90 ']")
    turned = page.locator("#motor-2 .disc").bounding_box()
    assert turned["y"] > before["y"] + 100
    assert turned["x"] == pytest.approx(before["x"], abs=1.0)


def test_grams_and_kilograms_are_distinguished(page: Any) -> None:
    page.select_option("#mass-unit-0", "kg")
    fill(page, "#mass-0", "428")
    page.get_by_role("button", name="It is 428 g").click()
    page.get_by_text("That is 0.428 kg.").wait_for()
    assert page.input_value("#mass-0") == "428"
    assert page.input_value("#mass-unit-0") == "g"


def test_a_broken_log_shows_its_one_line(page: Any, tmp_path: Path) -> None:
    broken = tmp_path / "broken.ulg"
    broken.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(40))
    with pytest.raises(LogError) as refused:
        read_log(broken)
    drop(page, broken.name, broken.read_bytes())
    words = page.locator(".file [role=alert]").inner_text()
    assert words == str(refused.value).replace(str(broken), broken.name)
    page.get_by_role("button", name="Remove broken.ulg").click()
    page.locator(".file").wait_for(state="detached")
    assert page.evaluate("document.activeElement.id") == "logs"  # where the button was


@pytest.mark.slow
def test_an_experiment_file_with_two_configurations(page: Any, tmp_path: Path) -> None:
    plan = plan_experiment("payload-pair", "clean", seed=1, seconds=15.0)
    dropped = [tmp_path / "experiment.toml"]
    lines = experiment_text(plan).splitlines()
    said = [line for line in lines if "B2.csv" not in line and not line.startswith("law = ")]
    dropped[0].write_text("\n".join(said), encoding="utf-8")
    for flight in planned_flights(plan):
        if flight.file in ("A1.csv", "A2.csv", "B1.csv"):
            dropped.append(tmp_path / flight.file)
            dropped[-1].write_text(table_text(plan, fly(plan, flight)), encoding="utf-8")
    page.set_input_files("#files", dropped)
    for flight in dropped[1:]:
        page.locator(".file", has_text=flight.name).locator(".section").first.wait_for()
    page.locator("#identify[aria-disabled=false]").wait_for()
    assert [page.input_value(f"#mass-{i}") for i in (0, 1)] == ["1400", "1600"]
    assert page.input_value("[id='use-A2.csv-0']") == "0 validation"
    page.click("#identify")
    page.wait_for_selector("tr[data-name=kt]")
    titles = page.locator(".parameter-table h3").all_text_contents()
    assert {"Body, configuration A", "Body, configuration B"} <= set(titles)
    assert page.locator("tr[data-name=mass] .number").all_text_contents() == ["1.4", "1.6"]
    kept_apart = page.get_by_role("region", name="Flights kept apart")
    assert kept_apart.locator("tbody th").all_text_contents() == ["A2.csv"]
    page.select_option("#of", "B")
    model = exported(page, "gazebo", tmp_path).read_text(encoding="utf-8")
    assert "<maxRotVelocity>" in model
    fill(page, "#mass-1", "1601")
    page.get_by_text("The page has changed since the result below").wait_for()


def test_the_keyboard_does_all_of_it(page: Any, flown_log: Flown) -> None:
    def tab_to(selector: str) -> None:
        for _ in range(60):
            page.keyboard.press("Tab")
            if page.evaluate("(s) => document.activeElement.matches(s)", selector):
                return
        pytest.fail(f"no Tab leads to {selector}")

    # Chromium hands a chooser over from some moment after it is asked to: ask well before.
    page.on("filechooser", lambda chooser: None)
    tab_to("#files")
    with page.expect_file_chooser() as chooser:
        page.keyboard.press("Enter")
    chooser.value.set_files(flown_log.path)
    page.wait_for_selector(".file .section")
    tab_to("#motor-1")
    page.keyboard.press("Enter")
    page.wait_for_selector("#motor-1[aria-label*=counterclockwise]")
    assert page.evaluate("document.activeElement.id") == "motor-1"
    page.keyboard.press(" ")
    page.wait_for_selector("#motor-1:not([aria-label*=counterclockwise])")
    tab_to("input[value=arm]")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#size-1")
    for field, text in zip(("#size-0", "#size-1"), flown_log.spacing, strict=True):
        tab_to(field)
        page.keyboard.type(text)
    tab_to("#mass-0")
    page.keyboard.type(flown_log.mass)
    tab_to("#identify")
    page.keyboard.press("Enter")
    tab_to("#stop")
    page.keyboard.press("Enter")
    assert page.inner_text("#refusal").startswith("Stopped")
    assert page.evaluate("document.activeElement.id") == "identify"
    page.keyboard.press("Enter")
    page.wait_for_selector("#stop")
    page.reload()  # which takes part again in what runs
    page.click("#stop")
    assert page.inner_text("#refusal").startswith("Stopped")
    assert page.locator("tr[data-name=kt]").count() == 0


@pytest.fixture(scope="module")
def mapped(browser: Any, address: str, seen: Seen, unknown_table: bytes) -> Any:
    """A page on which an unknown table lies, its columns proposed."""
    page = opened(browser, address, seen)
    drop(page, "own.csv", unknown_table)
    page.wait_for_selector(".columns .mapped")
    return page


def test_the_columns_of_an_unknown_table_are_mapped(mapped: Any, tmp_path: Path) -> None:
    assert mapped.locator(".mapped tr[data-is]").count() == 11
    assert mapped.locator("tr[data-is=gyro_x] .preview span").count() == 3
    assert "says axes FLU (z up)" in mapped.inner_text(".columns")
    mapped.select_option("#unit-of-gyro", "rad/s")
    mapped.wait_for_selector("#unit-of-gyro", state="detached")
    mapped.select_option("#unit-of-motors", "rad/s")
    mapped.wait_for_selector(".file > .finding b")
    mapped.select_option("#table-axes", "FRD")
    mapped.wait_for_selector(".columns .finding.weak >> text=gravity would lie upside down")
    mapped.click("[data-do=propose-again]")
    mapped.select_option("#unit-of-gyro", "rad/s")
    mapped.wait_for_selector("#unit-of-gyro", state="detached")
    mapped.select_option("#unit-of-motors", "rad/s")
    mapped.wait_for_selector(".file > .finding b")
    assert mapped.locator(".columns .finding.weak").count() == 0
    mapped.select_option("#column-rotor_1", "m2")
    mapped.select_option("#column-rotor_2", "m1")
    mapped.wait_for_selector("#stop", state="detached")
    fill(mapped, "#size-0", "200")
    fill(mapped, "#mass-0", "1285")
    text = downloaded(mapped, "Download the experiment file", tmp_path).read_text()
    assert '[table.columns]\ntime = { name = "t", unit = "s" }' in text
    assert 'rotor_1 = { name = "m2", unit = "rad/s" }\nrotor_2 = { name = "m1"' in text
    assert 'flights = ["own.csv"]' in text
    mapped.reload()
    mapped.wait_for_selector(".mapped")
    assert mapped.input_value("#column-rotor_1") == "m2"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_columns_fit_a_phone_and_everybody(mapped: Any, scheme: str) -> None:
    mapped.set_viewport_size({"width": 390, "height": HEIGHT})
    assert mapped.evaluate("document.documentElement.scrollWidth") <= 390
    assert violations(mapped, scheme) == []
    mapped.set_viewport_size({"width": WIDTH, "height": HEIGHT})


def test_columns_are_answered_by_keyboard(page: Any, unknown_table: bytes) -> None:
    drop(page, "own.csv", unknown_table)
    for question in ("#unit-of-gyro", "#unit-of-motors"):
        page.focus(question)
        page.keyboard.press("r")  # rad/s, the first of that letter
        page.keyboard.press("Tab")
        page.wait_for_selector(question, state="detached")
    page.wait_for_selector(".file > .finding b")
    assert page.input_value("#unit-gyro_x") == "rad/s"


def test_pictures_of_the_documentation(
    work: Any, mapped: Any, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """They are taken every time, and kept where that is asked for."""
    folder = PICTURES if request.config.getoption("--update-pictures") else tmp_path
    work.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = false; })")
    pictures = {
        "app-vehicle": (work, "#vehicle", "light", WIDTH),
        "app-result": (work, "#outcome", "dark", WIDTH),
        "app-phone": (work, "#logs", "light", 390),
        "app-columns": (mapped, ".columns", "light", WIDTH),
    }
    for name, (page, section, scheme, width) in pictures.items():
        page.set_viewport_size({"width": width, "height": HEIGHT})
        page.emulate_media(color_scheme=scheme)
        page.evaluate("(s) => document.querySelector(s).scrollIntoView()", section)
        page.screenshot(path=tmp_path / "taken.png")
        small(tmp_path / "taken.png", folder / f"{name}.png")
        assert 10_000 < (folder / f"{name}.png").stat().st_size < 120_000
        page.emulate_media(color_scheme="light")
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})


def small(taken: Path, picture: Path) -> None:
    """Keep a picture in 256 colours, which a page like this has not more of."""
    image = pytest.importorskip("PIL.Image", reason="needs Pillow, which matplotlib brings")
    with image.open(taken) as one:
        one.convert("RGB").quantize(256, image.Quantize.MAXCOVERAGE).save(picture, optimize=True)


def test_nothing_complained_and_nothing_left_the_machine(work: Any, seen: Seen) -> None:
    assert work.url.startswith("http://127.0.0.1:")
    assert seen.foreign == []
    assert seen.complaints == []
