"""rotorfit.plot: what is drawn is what the result says, on the axes that were given."""

import sys

import numpy as np
import pytest
from report_material import a_comparison, a_result

import rotorfit
from rotorfit.errors import OutputError
from rotorfit.results.validation.replay import Predicted, Replay

matplotlib = pytest.importorskip("matplotlib", reason="pip install matplotlib")
matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def closed():
    from matplotlib import pyplot

    yield
    pyplot.close("all")


def test_intervals_are_at_their_ends():
    axes = rotorfit.plot.intervals(a_result(), ["kt", "com_x", "Izz_com"])
    assert [a.get_title(loc="left") for a in axes] == ["kt [N s²/rad²]", "com_x [m]"]
    bar, dot = axes[0].get_lines()
    assert list(bar.get_xdata()) == [3.61e-6, 3.65e-6]
    assert list(dot.get_xdata()) == [3.63e-6]
    assert [t.get_text() for t in axes[1].get_yticklabels()] == ["A", "B"]


def test_wrenches_show_both_sides_on_the_axes_given():
    from matplotlib import pyplot

    flight = a_comparison()
    _, mine = pyplot.subplots(4, 1)
    axes = rotorfit.plot.wrenches(flight, axes=list(mine))
    assert axes == list(mine)
    body, rotor = axes[0].get_lines()
    shown = body.get_ydata()
    np.testing.assert_allclose(shown[np.isfinite(shown)], flight.body_wrench[:, 2])
    assert rotor.get_label() == "produced by the rotors"


def test_correlations_are_of_the_covariance():
    result = a_result()
    axis = rotorfit.plot.correlations(result)
    shown = axis.images[0].get_array()
    std = np.sqrt(np.diag(result.covariance))
    np.testing.assert_allclose(shown, result.covariance / np.outer(std, std), atol=1e-12)


def test_too_few_axes_and_nothing_to_draw_are_refused():
    with pytest.raises(OutputError, match="1 axes were given for 2 plots: give 2"):
        rotorfit.plot.intervals(a_result(), ["kt", "com_x"], axes=[None])
    with pytest.raises(OutputError, match="none of kd, Jr has a value"):
        rotorfit.plot.intervals(a_result(), ["kd", "Jr"])


def test_without_matplotlib_a_plot_is_refused_in_words(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(OutputError, match=r"rotorfit.plot needs matplotlib .*pip install"):
        rotorfit.plot.intervals(a_result())


def test_a_replay_is_broken_between_its_windows():
    time = np.array([[0.0, 0.1, 0.2], [0.3, 0.4, 0.5], [0.6, 0.7, 0.8]])
    rates = np.arange(27.0).reshape(3, 3, 3)
    own = Predicted(
        label="identified", rates=rates + 1.0, rates_std=0 * rates, force=np.zeros((3, 1, 3))
    )
    flown = Replay(
        flight="a.csv",
        sha256="",
        configuration="A",
        time=time,
        block=0.05,
        rates=rates,
        force=np.zeros((3, 1, 3)),
        predicted=(own,),
    )
    axes = rotorfit.plot.replay_axes(flown, seconds=(0.0, 0.55))
    assert [axis.get_ylabel() for axis in axes] == [
        "roll rate [rad/s]", "pitch rate [rad/s]", "yaw rate [rad/s]"
    ]  # fmt: skip
    measured, predicted = axes[2].get_lines()
    np.testing.assert_array_equal(measured.get_ydata(), [2, 5, 8, np.nan, 11, 14, 17, np.nan])
    np.testing.assert_array_equal(predicted.get_ydata(), [3, 6, 9, np.nan, 12, 15, 18, np.nan])
