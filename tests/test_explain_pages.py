"""What the terminal's page says: numbers to two digits of their std, words for signs, nothing where there is nothing."""

from types import SimpleNamespace

import pytest

from session.io.units import DEG
from tinygc.explanation.claims import Considered, measured
from tinygc.explanation.result import MOST_SAID, considered_lines, equivalent_words, noise_rows, rival_words
from tinygc.reporting.explanation_text import parameter_lines


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.00095123, 0.0000123, "0.000951 ± 0.000012"),
        (0.0000101, 0.0000004, "0.00001010 ± 0.00000040"),
        (-0.155034, 0.00628, "-0.1550 ± 0.0063"),
        (217.2071, 0.4344, "217.21 ± 0.43"),
        (60.17, 12.4, "60 ± 12"),
        (1234.0, 120.0, "1230 ± 120"),
        (0.5, 0.0996, "0.50 ± 0.10"),
        (9.5, 0.999, "9.5 ± 1.0"),
    ],
)
def test_a_value_ends_where_two_digits_of_its_std_end(value, std, text):
    assert measured(value, std) == text


@pytest.mark.parametrize("std", [None, 0.0, float("nan"), float("inf")])
def test_a_value_without_a_std_has_five_digits(std):
    assert measured(3.14159265, std) == "3.1416"
    assert measured(12.0, std) == "12"


def test_a_parameter_that_is_a_text_is_a_line_like_any_other():
    """What an axis skew is of stands among its numbers."""
    claim = SimpleNamespace(
        parameters={"seconds": [0.0, 0.00032, 0.02009], "of": "readings", "order": 3}, std={"seconds": [0.0, 0.00037, 0.00039]}
    )
    assert parameter_lines(claim) == ["seconds: 0   0.00032 ± 0.00037   0.02009 ± 0.00039", "of: readings", "order: 3"]


NAMES = [Considered(f"gyro.name{number}", 0.4 - 0.05 * number) for number in range(4)]
TINY = [Considered(f"gyro.tiny{number}", 1e-6) for number in range(20)]


def test_what_a_detector_proposed_is_told_before_names_and_tiny_ones_never():
    lost = Considered("timing.dropped_samples", 0.0, 28, (0.5 * DEG, 0.5 * DEG))
    false = Considered("data.glitches", 0.0, 1, (0.5 * DEG, 2 * DEG))
    level = Considered("gyro.saturation", 0.0, 3)
    assert considered_lines(SimpleNamespace(considered=[*NAMES, *TINY, lost, false, level])) == [
        "timing.dropped_samples at 28 moments: closure there is 0.500°, and no number of lost samples makes it better",
        "data.glitches at 1 moment: closure there is 0.500° as recorded, 2.000° once mended",
        "gyro.saturation: 3 segments reach a level, and close like the others",
        "gyro.name0: probability 0.4",
        "gyro.name1: probability 0.35",
        "gyro.name2: probability 0.3",
    ]
    assert considered_lines(SimpleNamespace(considered=TINY)) == []
    assert MOST_SAID == 6


def test_rivals_are_told_with_their_probability():
    claim = SimpleNamespace(rivals={"a.tiny": 1e-9, "a.rival": 0.1, "a.like": 0.3}, equivalent=("a.like", "a.unweighed"))
    assert rival_words(claim) == ["a.rival (0.1)"]
    assert equivalent_words(claim) == ["a.like (0.3)", "a.unweighed"]


def test_noise_is_told_with_its_sigma_where_that_is_known():
    one = {"name": "noise.turn", "size": 0.0123, "unit": "deg", "description": "each turn errs"}
    noise = SimpleNamespace(to_json=lambda: [one | {"sigma": 0.004}, one | {"sigma": None}])
    sizes = [size for _, size, _ in noise_rows(SimpleNamespace(noise=noise))]
    assert sizes == ["0.0123 ± 0.0040 deg", "0.0123 deg"]
