"""Capability against limits: exact where there is a formula, intervals that hold, limits that are refused."""

import math

import numpy as np
import pytest
from scipy import stats

from session.io.errors import FormatError
from tinygc.annexes.lots.capability import GUARD_SIGMAS, capability, indices, outside_ppm, read_limits, risks


def test_indices_by_hand():
    found = indices(-6, 6, 1.5, 1.0, 99, 100)
    assert found.index == pytest.approx(2.0)
    assert found.centred == pytest.approx(1.5)
    one_sided = indices(-math.inf, 6, 1.5, 1.0, 99, 100)
    assert np.isnan(one_sided.index)
    assert one_sided.centred == pytest.approx(1.5)


def test_six_sigma_is_two_parts_per_billion():
    assert outside_ppm(-6, 6, 0, 1) == pytest.approx(1.973e-3, rel=1e-3)
    assert outside_ppm(-3, 3, 0, 1) == pytest.approx(2699.8, rel=1e-4)
    assert outside_ppm(-3, 3, 0, 1, tails=5.0) > 2 * outside_ppm(-3, 3, 0, 1)
    assert outside_ppm(-3, 3, 0, 1, tails=1e6) == pytest.approx(2699.8, rel=1e-3)


def test_intervals_hold_the_truth():
    """Of 400 lots of 50, both intervals hold the true index in 95 %; fewer than 365 in one of ten thousand."""
    inside = np.zeros(2)
    for seed in range(400):
        y = np.random.default_rng(seed).normal(0.5, 1, 50)
        found = indices(-4, 4, y.mean(), y.std(ddof=1), 49, 50)
        inside += [lo <= true <= hi for (lo, hi), true in ((found.index_interval, 4 / 3), (found.centred_interval, 3.5 / 3))]
    assert inside.min() >= stats.binom.ppf(1e-4, 400, 0.95)


def test_risks_against_a_million_units():
    rng = np.random.default_rng(0)
    x = rng.normal(0.2, 1, 1_000_000)
    y = x + rng.normal(0, 0.3, 1_000_000)
    for guard in (0.0, 0.2):
        accept, reject = risks(-2, 2, 0.2, 1, 0.3, guard)
        kept, good = np.abs(y) <= 2 - guard, np.abs(x) <= 2
        assert accept == pytest.approx(np.sum(kept & ~good), rel=0.05)
        assert reject == pytest.approx(np.sum(~kept & good), rel=0.05)


def test_a_guard_band_keeps_a_unit_at_its_limit_to_one_in_twenty():
    assert stats.norm.sf(GUARD_SIGMAS) == pytest.approx(0.05)
    found = capability((-2, 2), 0.0, 1.0, 0.3, 1.0, 99, np.inf, np.zeros(100))
    assert found.guard_band == pytest.approx(0.3 * GUARD_SIGMAS)
    assert found.guarded_accept_ppm < found.false_accept_ppm / 5
    assert found.guarded_reject_ppm > found.false_reject_ppm


def test_noise_is_taken_out_and_seen():
    found = capability((-6, 6), 0.0, 1.0, 0.75, 1.0, 99, np.inf, np.array([0.0, 7.0, np.nan]))
    assert found.overall.index == pytest.approx(2.0)
    assert found.observed.index == pytest.approx(2.0 / 1.25)
    assert (found.found_outside, found.units) == (1, 2)


def limits(tmp_path, text, head='schema = "tinygc-limits/1"\n'):
    path = tmp_path / "limits.toml"
    path.write_text(head + text, encoding="utf-8")
    return path


def test_one_component_wins_over_all_of_its_kind(tmp_path):
    found = read_limits(limits(tmp_path, "[gyro_bias_y_mdps]\nupper = 7\n[gyro_bias_mdps]\nlower = -1\nupper = 2\n"))
    assert found["gyro_bias_x_mdps"] == (-1, 2)
    assert found["gyro_bias_y_mdps"] == (-math.inf, 7)
    assert len(found) == 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no limits, expected a section"),
        ("[gyro_bias_mdsp]\nupper = 2\n", "did you mean gyro_bias_mdps"),
        ("[gyro_bias_mdps]\n", "has no limit"),
        ("[gyro_bias_mdps]\nuper = 2\n", "uper is no key"),
        ("[gyro_bias_mdps]\nlower = 3\nupper = 2\n", "lower is 3, expected less than upper, 2"),
        ('[gyro_bias_mdps]\nlower = "3"\n', "lower is 3, expected a number"),
        ("[gyro_bias_mdps]\nlower = nan\n", "lower is nan, expected a number"),
        ("gyro_bias_mdps = 3\n", "expected a section"),
        ("[gyro_bias_mdps\n", "broken TOML"),
    ],
)
def test_limits_that_are_none_are_refused_in_one_line(tmp_path, text, says):
    with pytest.raises(FormatError, match=says) as refused:
        read_limits(limits(tmp_path, text))
    assert "\n" not in str(refused.value)
    assert "limits.toml" in str(refused.value)


def test_a_file_of_another_kind_is_refused(tmp_path):
    with pytest.raises(FormatError, match="no limits of a lot"):
        read_limits(limits(tmp_path, "", "[gyro_bias_mdps]\nupper = 1\n"))
