"""What the report's page is drawn with: colours, numbers, axes, charts, the sphere."""

import numpy as np
import pytest

from session.base.texts import measured
from tinygc.noise.stillness import density
from tinygc.reporting import facts
from tinygc.reporting.drawing import COLOURS, Axis, Panel, Picture, to_one_scale


@pytest.mark.parametrize("shade", [0, 1], ids=["light", "dark"])
def test_colours_stand_out_from_the_page(shade):
    """WCAG 2: 4.5 for letters, 3 for shapes."""

    def luminance(colour):
        channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        return np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]

    def contrast(a, b):
        light, dark = sorted((luminance(a), luminance(b)), reverse=True)
        return (light + 0.05) / (dark + 0.05)

    colours = {name: shades[shade] for name, shades in COLOURS.items()}
    for page in (colours["page"], ("#f6f7f9", "#1b1f25")[shade]):  # and the panel of the answer
        assert contrast(colours["ink"], page) > 7
        assert contrast(colours["soft"], page) > 4.5
        for name in colours.keys() - {"page", "rule", "grid"}:
            assert contrast(colours[name], page) > (3 if name == "quiet" else 4.4), name


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [
        (-10782.54, 45.06, "−10\u202f783 ± 45"),
        (-10782.54, 451.0, "−10\u202f780 ± 450"),
        (0.630723, 0.0023046, "0.6307 ± 0.0023"),
        (1.5, 0.0, "1.5"),
        (-0.0001, 0.02, "0.000 ± 0.020"),
    ],
)
def test_numbers_have_the_digits_that_are_known(value, sigma, said):
    assert facts.typeset(measured(value, sigma), True) == said


def test_a_panel_places_what_it_is_given():
    panel = Panel(Axis("x", 0, 10), Axis("y", log=True), about="about <it>")
    panel.points([0, 10, 5], [0.01, 1.0, np.nan], "y", labels=["a", "b", "<c>"], name="dots")
    shapes, _ = Picture([panel]).shapes(400)
    (dots,) = [shape for shape in shapes if shape.radius and len(shape.parts[0]) > 1]
    ((left, bottom), (right, _)) = next(shape.parts[0] for shape in shapes if shape.kind == "rule")
    (x0, y0), (x1, y1) = dots.parts[0]
    assert (x0, x1) == pytest.approx((left, right))
    assert (bottom - y0) / (y0 - y1) == pytest.approx(np.log(0.01 / 0.005) / np.log(100))
    assert list(dots.labels) == ["a", "b"]
    svg = panel.line(np.linspace(0, 10, 100_000), np.full(100_000, 0.5), "x").svg(400)
    assert len(svg) < 40_000
    assert svg.count("<circle") == 3  # with that of the legend
    assert "about &lt;it&gt;" in svg


def test_a_line_beyond_the_frame_is_cut_off_and_an_infinite_end_is_at_the_frame():
    panel = Panel(Axis(lo=0, hi=1), Axis(lo=0, hi=1)).line([0, 1], [-3, 3], "x").upright(0.5)
    cut, upright = [shape for shape in Picture([panel]).shapes(300)[0] if shape.kind in ("x", "floor")]
    left, top, right, bottom = cut.clip
    np.testing.assert_allclose(upright.parts[0], [[(left + right) / 2, bottom], [(left + right) / 2, top]])
    assert panel.svg(300).count("<svg") == 2


def test_panels_of_one_scale_hold_the_data_of_both_and_an_equal_scale_is_equal():
    panels = [Panel().points([0, 1], [0, 5], "x"), Panel().points([2, 3], [1, 2], "x")]
    to_one_scale(*panels)
    assert panels[0].ends() == panels[1].ends()
    assert panels[0].ends()[1] == pytest.approx((-0.3, 5.3))
    circle = Panel(is_equal=True).points([-1, 1, 0, 0], [0, 0, -1, 1], "x")
    (dots,) = [shape.parts[0] for shape in Picture([circle]).shapes(500)[0] if shape.radius]
    assert np.ptp(dots[:, 0]) == pytest.approx(np.ptp(dots[:, 1]))


def test_a_thinned_line_keeps_its_highest_and_its_lowest_point_and_its_gap():
    y = np.full(50_000, 0.5)
    y[31_234], y[31_235], y[40_000:40_100] = 1.0, 0.0, np.nan
    panel = Panel(Axis(lo=0, hi=50_000), Axis(lo=0, hi=1)).line(np.arange(50_000), y, "x")
    (line,) = [shape for shape in Picture([panel]).shapes(300)[0] if shape.kind == "x"]
    heights = np.concatenate(line.parts)[:, 1]
    assert np.ptp(heights) == pytest.approx(panel.height)
    assert len(line.parts) == 2


@pytest.mark.parametrize(
    ("values", "zero", "ends"), [([1.0, 3.0], False, (0.88, 3.12)), ([1.0, 3.0], True, (0.0, 3.18)), ([2.0, np.nan], False, (1.8, 2.2))]
)
def test_a_linear_axis_has_room_on_both_sides_but_where_it_ends_at_zero(values, zero, ends):
    assert Axis(zero=zero).ends(np.array(values)) == pytest.approx(ends)


@pytest.mark.parametrize(("lengths", "rate_hz"), [((208, 300, 517), 208.0), ((99, 100, 333), 99.0), ((20, 19, 4), 100.0)])
def test_the_spectrum_is_that_of_scipys_welch(lengths, rate_hz):
    from scipy.signal import welch

    pieces = [np.random.default_rng(n).standard_normal((n, 3)) + 5 for n in lengths]
    size = min(round(rate_hz), max(lengths))
    long = [piece for piece in pieces if len(piece) >= size]
    powers = [welch(piece, rate_hz, nperseg=size, axis=0) for piece in long]
    mean = np.average([power for _, power in powers], axis=0, weights=[2 * len(piece) // size - 1 for piece in long])
    frequency, amplitude = density(pieces, 1 / rate_hz)
    np.testing.assert_allclose(frequency, powers[0][0][1:], rtol=1e-12)
    np.testing.assert_allclose(amplitude, np.sqrt(mean)[1:], rtol=1e-12)
