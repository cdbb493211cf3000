"""Drawings: true to scale, extremes kept, files well formed."""

import base64
import importlib
import re
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_material import ROTORS, a_comparison, a_result

from rotorfit.digits import number_of
from rotorfit.errors import OutputError
from rotorfit.report.chart import encoded, encoded_time, path_of
from rotorfit.report.pages import HINT, nice_step, tick_label, ticks, write_drawings
from rotorfit.report.result_page import figure_texts
from rotorfit.report.scene import scene_of
from rotorfit.report.vehicle import SIDE, TOP, whole_view
from rotorfit.report.wrenches import series_of
from rotorfit.series import Series, column_starts, extremes, thinned

SVG = "{http://www.w3.org/2000/svg}"


def _scene():
    scene = scene_of(a_result(configurations=("A",)))
    assert scene is not None
    return scene


def test_rotors_are_drawn_where_they_are() -> None:
    root = ElementTree.fromstring(whole_view(_scene(), TOP))
    scale = float(root.attrib["data-scale"])
    discs = {
        g.attrib["data-rotors"]: g.find("circle")
        for g in root.iter("g")
        if "data-rotors" in g.attrib
    }
    places = {}
    for number, disc in discs.items():
        assert disc is not None
        places[int(number)] = (float(disc.attrib["cx"]), float(disc.attrib["cy"]))
    x0, y0 = np.mean(list(places.values()), axis=0)
    for number, (px, py) in places.items():
        x, y, _ = ROTORS[number - 1]["position"]
        # Seen from above with the front up: up the page is x, to the left is y.
        assert (y0 - py) / scale == pytest.approx(x, abs=1e-4)
        assert (x0 - px) / scale == pytest.approx(y, abs=1e-4)


def test_the_scale_bar_is_as_long_as_it_says() -> None:
    for axes in (TOP, SIDE):
        root = ElementTree.fromstring(whole_view(_scene(), axes))
        bar = next(g for g in root.iter("g") if g.attrib.get("class") == "scale-bar")
        d = bar.find("path").attrib["d"]  # type: ignore[union-attr]
        x0, x1 = (float(v) for v in re.search(r"M([\d.]+) [\d.]+H([\d.]+)", d).groups())  # type: ignore[union-attr]
        metres = float(bar.attrib["data-metres"])
        assert (x1 - x0) / float(root.attrib["data-scale"]) == pytest.approx(metres, rel=1e-3)


def test_spin_arrows_turn_as_the_rotors_do() -> None:
    root = ElementTree.fromstring(whole_view(_scene(), TOP))
    arrows = [g for g in root.iter("g") if g.attrib.get("class", "").startswith("spin")]
    assert [g.attrib["class"].split()[1] for g in arrows] == ["ccw", "ccw", "cw", "cw"]
    for g in arrows:
        sweep = g.find("path").attrib["d"].split()[5]  # type: ignore[union-attr]
        # SVG: sweep 1 is clockwise on the page.
        assert sweep == ("0" if "ccw" in g.attrib["class"] else "1")


def test_com_and_payload_are_drawn_where_they_are() -> None:
    root = ElementTree.fromstring(whole_view(_scene(), TOP))
    scale = float(root.attrib["data-scale"])
    imu = next(r for r in root.iter("rect") if r.attrib["class"] == "imu")
    load = next(r for r in root.iter("rect") if r.attrib["class"] == "payload")
    com = next(c for c in root.iter("circle") if c.attrib["class"] == "ring")
    imu_y = float(imu.attrib["y"]) + float(imu.attrib["height"]) / 2
    load_y = float(load.attrib["y"]) + 6
    assert (imu_y - load_y) / scale == pytest.approx(0.375 - 0.03, abs=1e-4)
    assert (imu_y - float(com.attrib["cy"])) / scale == pytest.approx(0.01 - 0.03, abs=1e-4)


def test_the_origin_without_a_known_imu_is_the_imu() -> None:
    result = a_result(configurations=("A",))
    airframe = {k: v for k, v in result.settings["airframe"].items() if k != "imu"}
    scene = scene_of(a_result(configurations=("A",), settings={"airframe": airframe}))
    assert scene is not None
    assert scene.imu_label.startswith("IMU (the origin;")
    assert scene.imu == (0.0, 0.0, 0.0)


def test_coaxial_rotors_share_a_circle() -> None:
    above = [{**r, "position": [*r["position"][:2], 0.05], "spin": "cw"} for r in ROTORS]
    scene = scene_of(a_result(settings={"airframe": {"rotors": [*ROTORS, *above]}}))
    assert scene is not None
    root = ElementTree.fromstring(whole_view(scene, TOP))
    numbers = [g.attrib["data-rotors"] for g in root.iter("g") if "data-rotors" in g.attrib]
    assert numbers == ["1/5", "2/6", "3/7", "4/8"]


@given(st.integers(10, 3000), st.integers(2, 60), st.integers(0, 10**6))
def test_reduced_series_keep_their_extremes(n: int, columns: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.choice([0.005, 0.005, 0.005, 1.0], size=n, p=[0.5, 0.3, 0.19, 0.01]))
    series = Series(time=time, values={"Fz error": rng.normal(size=n)}, gap=0.015)
    values = series.values["Fz error"]
    starts = column_starts(series, columns)
    pairs = extremes(values, starts)
    assert pairs.min() == values.min()
    assert pairs.max() == values.max()
    for k, part in enumerate(np.split(values, starts[1:])):
        assert sorted(pairs[k]) == [part.min(), part.max()]
    small = thinned(series, columns=columns).values["Fz error"]
    assert (small.min(), small.max()) == (values.min(), values.max())


def test_a_path_breaks_at_cuts_and_reaches_the_extremes() -> None:
    series = series_of(a_comparison(seconds=10))
    values = series.values["Fz error"]
    low, high = float(values.min()), float(values.max())
    d = path_of(series, "Fz error", size=(700.0, 100.0), span=(low, high))
    assert d.count("M") == 2
    heights = [float(v) for v in re.findall(r"[ V]([\d.]+)(?=[LMV]|$)", d)]
    assert (min(heights), max(heights)) == (0.0, 100.0)


def test_samples_that_are_no_numbers_are_left_out() -> None:
    comparison = a_comparison(seconds=2)
    comparison.rotor_wrench[7, 2] = np.nan
    series = series_of(comparison)
    assert len(series.time) == len(comparison.time) - 1


def test_the_encoding_is_read_back_to_a_sixteen_bit_step() -> None:
    values = np.random.default_rng(3).normal(size=1000)
    packed = encoded(values)
    integers = np.frombuffer(base64.b64decode(str(packed["data"])), "<i2").astype(float)
    back = float(packed["low"]) + (integers + 32768) * float(packed["step"])
    assert np.abs(back - values).max() <= 0.51 * float(packed["step"])
    times = np.frombuffer(base64.b64decode(encoded_time(values)), "<f4")
    assert np.abs(times - values).max() < 1e-6
    assert encoded(np.zeros(0))["data"] == ""
    assert encoded(np.full(3, 2.5))["low"] == 2.5


def test_a_flight_without_samples_is_drawn_empty() -> None:
    names = figure_texts(a_result(), [a_comparison(seconds=0.0)])
    assert len(names) == 6


@given(st.floats(1e-9, 1e9), st.integers(2, 12))
def test_ticks_are_round_and_about_as_many_as_asked(span: float, count: int) -> None:
    step = nice_step(span, count)
    assert f"{step:.0e}"[0] in "1245"
    values = ticks(0.0, span, count)
    assert 2 <= len(values) <= 2 * count + 1
    assert tick_label(0.0, step).strip("0.") == ""


@pytest.mark.parametrize(
    ("value", "interval", "shown"),
    [
        (2.656e-7, (2.604e-7, 2.708e-7), "(2.656 ± 0.052) × 10⁻⁷"),
        (0.0182, (0.0178, 0.0186), "0.01820 ± 0.00040"),
        (-0.0063, (-0.008, -0.0046), "−0.0063 ± 0.0017"),
        (1.285, None, "1.285"),
        (1.0, (0.9, 1.5), "1.00 ± 0.30"),
    ],
)
def test_numbers_have_two_digits_of_their_half_width(
    value: float, interval: tuple[float, float] | None, shown: str
) -> None:
    if shown == "1.00 ± 0.30":
        shown = "1.00 (0.90 to 1.50)"
    assert str(number_of(value, interval)) == shown


def test_figures_are_svg_files_that_stand_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "resvg_py", None)
    comparison = a_comparison(flight="../<odd> name.csv", seconds=5)
    paths = write_drawings(tmp_path / "figures", figure_texts(a_result(), [comparison]))
    assert [p.name for p in paths] == [
        "vehicle-top.svg", "vehicle-side.svg", "center-top.svg", "center-side.svg",
        "wrench-1-A-odd-name.svg", "correlations.svg",
    ]  # fmt: skip
    for path in paths:
        root = ElementTree.fromstring(path.read_bytes())
        assert root.tag == f"{SVG}svg"
        assert float(root.attrib["width"]) > 100
        assert root.find(f"{SVG}style") is not None
    with pytest.raises(OutputError, match=r"already holds vehicle-top\.svg"):
        write_drawings(tmp_path / "figures", figure_texts(a_result(), [comparison]))
    assert (
        write_drawings(tmp_path / "figures", figure_texts(a_result(), [comparison]), force=True)
        == paths
    )
    assert 'pip install "rotorfit[figures]"' in HINT


def test_png_stands_next_to_svg_where_the_renderer_is_installed(tmp_path: Path) -> None:
    pytest.importorskip("resvg_py", reason='PNG needs the extra: pip install "rotorfit[figures]"')
    assert importlib.import_module("resvg_py")
    paths = write_drawings(tmp_path, figure_texts(a_result(), [a_comparison(seconds=5)]))
    png = [p for p in paths if p.suffix == ".png"]
    assert len(png) == 6
    assert all(p.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" for p in png)


def test_a_com_of_unknown_height_is_drawn_from_above_only() -> None:
    result = a_result(configurations=("A",))
    derived = tuple(
        replace(d, value=None, std=None, interval=None) if d.name == "com_z" else d
        for d in result.derived
    )
    drawn = figure_texts(replace(result, derived=derived))
    assert list(drawn) == ["vehicle-top", "vehicle-side", "center-top", "correlations"]
    assert 'class="ring"' in drawn["vehicle-top"]
    assert 'class="ring"' not in drawn["vehicle-side"]
