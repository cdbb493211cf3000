"""What the report shows by frequency, and the law of the motors, found or told."""

import re
from dataclasses import replace

import pytest
from report_material import FOUND, ROTORS, a_comparison, a_result

from flown import with_findings
from kept_words import lines_with
from rotorfit.findings import note
from rotorfit.report.chart import PLOT
from rotorfit.report.motor_law import law_picture, law_section
from rotorfit.report.result_page import figure_texts, report_html
from rotorfit.report.wrenches import excitation_chart, excitation_figure, excitation_sentences
from rotorfit.results.validation.wrench_comparison import wrench_spectra

TOLD = {
    "airframe": {"rotors": ROTORS},
    "motors": {"speed": "commanded", "law": {"linear": [0.0, 1000.0]}},
    "configuration": [{"name": "A", "mass": 1.0, "flights": ["A1.csv"]}],
}


def test_each_component_is_excited_where_it_was_moved(assert_wording) -> None:
    """Sines at 0.5 (Fz), 1.1, 1.3 and 0.7 Hz in white noise."""
    found = wrench_spectra([a_comparison()])
    assert found is not None
    for name, moved in (("Fz", 0.5), ("Mx", 1.1), ("My", 1.3), ("Mz", 0.7)):
        at = found.frequency[found.coherence[name] > 0.8]
        assert at.min() <= moved <= at.max() + 0.25
        assert abs(found.frequency[found.ratio[name].argmax()] - moved) <= 0.25
        assert at.max() < moved + 1.0
    words = excitation_sentences(found)
    assert [w.split(":")[0] for w in words] == ["Thrust", "Roll", "Pitch", "Yaw"]
    assert "over 0.8)" in words[1]
    assert_wording(words[1])


def test_an_axis_whose_rotors_do_little_says_so(assert_wording) -> None:
    still = a_comparison()
    still.rotor_wrench[:, 5] *= 1e-3
    found = wrench_spectra([still])
    assert found is not None
    words = excitation_sentences(found)[3]
    assert "to 1.00" in words
    assert_wording(words)
    assert "to 0.001 times" in words
    assert "fly" not in words  # what to fly is said once, by the next step


def test_the_page_draws_it_where_the_flights_are_long_enough(assert_wording) -> None:
    html = report_html(a_result(), comparisons=[a_comparison()])
    assert 'data-key="Mx coherence"' in html and 'data-key="Mz ratio"' in html
    short = report_html(a_result(), comparisons=[a_comparison(seconds=5.0)])
    assert "coherence" not in re.sub(r"<style>.*?</style>", "", short, flags=re.S)
    assert_wording(lines_with(short, "Not drawn"))
    assert excitation_figure([]) is None
    assert "excitation" in figure_texts(a_result(), [a_comparison()])


def test_the_axis_is_logarithmic_with_its_ends_at_the_grids() -> None:
    found = wrench_spectra([a_comparison()])
    assert found is not None
    low, high = excitation_chart(found).axis.ends
    assert (10**low, 10**high) == pytest.approx((0.25, 8.0))


def test_a_given_law_is_drawn_with_what_was_flown(assert_wording) -> None:
    flown = replace(a_comparison(seconds=2.0), speeds=(200.0, 800.0))
    result = a_result(configurations=("A",), settings=TOLD)
    section = law_section(result, [flown])
    assert section is not None and section.declared
    assert "were 200 to 800" in " ".join(section.sentences)
    assert "about 0.20 to 0.80" in " ".join(section.sentences)
    assert_wording(" ".join(section.sentences))
    assert_wording(section.sentences[0])
    by_flight = law_section(with_findings(result, note("law-found", "")), [flown])
    assert by_flight is not None
    assert_wording(by_flight.sentences[0])
    assert 'class="span seen"' in section.picture and "[rad/s]<" in section.picture
    alone = law_section(result)
    assert alone is not None
    assert 'class="span seen"' not in alone.picture
    assert_wording(lines_with(report_html(result, comparisons=[flown]), "rotor speed is by"))
    measured = {**TOLD, "motors": {"speed": "measured"}}
    assert law_section(a_result(configurations=("A",), settings=measured), [flown]) is None


def test_a_law_without_speeds_is_shown_as_shares(assert_wording) -> None:
    flown = replace(a_comparison(seconds=2.0), speeds=(0.2, 0.8))
    law = {"speed": "commanded", "law": {"linear": [0.0, 1.0]}}
    result = a_result(configurations=("A",), settings={**TOLD, "motors": law})
    relative = tuple(
        replace(p, unit="N per squared command") if p.name == "kt" else p for p in result.parameters
    )
    section = law_section(replace(result, parameters=relative), [flown])
    assert section is not None
    assert "were 0.20 to 0.80" in section.sentences[1]
    assert_wording(section.sentences[1])
    assert "[of full]<" in section.picture


def test_an_identified_law_has_a_band_dashed_beyond_the_flight() -> None:
    picture = law_picture(FOUND)
    [band] = re.findall(r'class="area spread" d="M([^"]*)Z"', picture)
    there, back = band.split("L")[:101], band.split("L")[101:]
    heights = [float(point.split()[1]) for point in (there[100], back[0])]
    full = 260.0 / (1.04 * 1100.0)  # pixels for a rad/s: the axis ends a little over the band
    assert heights[1] - heights[0] == pytest.approx(2 * 0.1 * 1000.0 * full, abs=0.2)
    [solid] = re.findall(r'class="curve rotor" data-key="rotor" d="M([^"]*)"', picture)
    ends = [float(point.split()[0]) for point in (solid.split("L")[0], solid.split("L")[-1])]
    assert ends == pytest.approx([0.2 * PLOT, 0.8 * PLOT], abs=6.0)
