"""The picture of a discovery: what stills and turns show of a law, where on its curve they stand, and panels that say what they show."""

import numpy as np
import pytest
from conftest import broad
from discovery_answers import LAWS, found, hidden, law_of, runner_up

from session.io.units import DEG
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.law_fits import LawSeries, curve, main_of, other_curve, pairs_of, series_of
from tinygc.annexes.discovery.pictures import figure_of, of_stills, of_turns
from tinygc.explanation.engine import explain_session
from tinygc.reporting.pictures.canvas import save

pytestmark = pytest.mark.broad

WARMER = LawForm((Factor("temperature", "itself"),))


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """An explanation of a session whose zero follows the root of the temperature, and its law beside a straight line, refitted."""
    e = explain_session(hidden("warm", tmp_path_factory.mktemp("pictures") / "warm"))
    answer = found(law_of(*LAWS["warm"], runners_up=(runner_up(WARMER),)))
    return e, answer, pairs_of(e, answer)


def test_terms_that_one_axis_has_from_one_component_are_one_series():
    of = {name: series_of(form) for name, (form, _) in LAWS.items()}
    assert [(each.axis, each.component, each.entries) for each in of["cross"]] == [(0, 1, (0,)), (1, 2, (1,)), (2, 0, (2,))]
    assert len(of["matrix"]) == 9
    assert (of["matrix"][5].axis, of["matrix"][5].component) == (1, 2)
    wave = series_of(LawForm((Factor("turned", "wave", 6.0),)))
    assert [(each.axis, each.entries) for each in wave] == [(0, (0, 1)), (1, (2, 3)), (2, (4, 5))]
    assert [each.axis for each in series_of(WARMER)] == [0, 1, 2]


@pytest.mark.parametrize("of", [broad(of_stills), broad(of_turns)])
def test_the_remainder_is_the_law_and_noise(warm, of):
    e, _, (pair,) = warm
    for series, dps in zip(series_of(pair.law.form), LAWS["warm"][1], strict=True):
        points = of(e, pair, series)
        assert len(points.x) >= 5
        assert np.sqrt(np.mean((points.left / points.sigma) ** 2)) < 1.8
        assert np.sqrt(np.mean((points.without / points.sigma) ** 2)) > 5
        # In a turn the temperature hardly moves: where it stands the law says what the turn asks for.
        assert points.without == pytest.approx(dps * np.sqrt(points.x), abs=5 * float(points.sigma.max()))
        at_them = curve(main_of(pair.law.form), points.x, pair.own.theta[list(series.entries)]) / DEG
        assert points.without - points.left == pytest.approx(at_them, abs=1e-3)


def test_the_runner_up_is_drawn_with_its_own_calibration(warm):
    """Its dashed curve runs through what it says of each still."""
    e, _, (pair,) = warm
    for series in series_of(pair.law.form):
        points = of_stills(e, pair, series)
        said = other_curve(e, pair.own, pair.other, series)
        assert points.other_says == pytest.approx(said(points.x) / DEG, abs=2e-3)
        assert np.linalg.norm(points.other_left) > 1.5 * np.linalg.norm(points.left)


def test_what_follows_another_quantity_has_no_curve(warm):
    e, _, (pair,) = warm
    force = law_of(LawForm((Factor("force", "itself"),)), [0.1, 0.1, 0.1])
    (other,) = pairs_of(e, found(force))
    assert other_curve(e, pair.own, other.own, LawSeries(0, 0, (0,))) is None


def readable(axes) -> None:
    """It says what its axes are, in units, and has something in it that lies within it."""
    assert axes.get_title()
    assert axes.get_xlabel().endswith(")")
    assert axes.get_ylabel().endswith(")")
    marks = [line for line in axes.lines if line.get_marker() not in ("None", None, "") and len(line.get_xdata())]
    marks += [marked for marked in axes.collections if len(marked.get_offsets()) > 3]
    assert len(marks) >= 1
    low, high = axes.get_ylim()
    inside = [low <= y <= high for line in marks if hasattr(line, "get_ydata") for y in line.get_ydata()]
    assert all(inside)
    assert axes.get_legend() is not None


def test_the_page_of_a_law_and_its_runner_up(warm, tmp_path):
    pytest.importorskip("matplotlib")
    figure = figure_of(*warm)
    assert len(figure.axes) == 4
    for axes in figure.axes:
        readable(axes)
    assert {axes.get_xlabel() for axes in figure.axes} == {"temperature since the first sample (°C)"}
    assert "c_i √|(T − T₀)|" in figure.get_suptitle()
    assert "runner-up:  ω_i += c_i (T − T₀)" in figure.get_suptitle()
    assert "with the runner-up" in figure.axes[1].get_title()
    save(figure, tmp_path / "discover.png")
    assert (tmp_path / "discover.png").stat().st_size > 20_000
