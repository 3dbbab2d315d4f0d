"""Noise terms of a unit: injected and recovered with their sigmas, not named where they are not, on real rests, beside temperature."""

from dataclasses import replace

import numpy as np
import pytest
from resting import samples_of, six, sums_of

from session.io.errors import DataError
from session.io.samples import Samples
from session.io.units import DEG, G
from tinygc.annexes.noise.choice import ODDS, Search
from tinygc.annexes.noise.curve import fit_curve
from tinygc.annexes.noise.dependence import sandwich
from tinygc.annexes.noise.estimate import _bands, _relative, described, estimate_noise, known_after_s
from tinygc.annexes.noise.likelihood import PRIOR_VARIANCE
from tinygc.annexes.noise.over_temperature import knots_of, temperature_part
from tinygc.annexes.noise.scales import groups_of, rest_of
from tinygc.annexes.noise.summary import RestSums, contrasts
from tinygc.noise.figures import TERMS, AxisNoise, Term, unit_allan_variance

DT = 0.01


def test_one_rest_gives_back_what_went_in():
    figures = estimate_noise([sums_of(six(2**15, DT, 5, N=1.0, K=1.0), DT)]).figures
    for axis in figures.gyro.axes:
        assert [name for name in TERMS if axis.terms[name].chosen] == ["N", "K"]
        for name in "NK":
            assert abs(axis.value(name) - 1) < 3.5 * axis.terms[name].sigma
        assert axis.terms["N"].sigma < 0.02
        assert axis.terms["K"].sigma < 0.2
        assert axis.terms["B"].at_most is not None
    assert figures.rate_hz == pytest.approx(100)
    assert figures.samples == 2**15


def test_stills_of_a_session_and_a_log_are_one_estimate():
    stills = [sums_of(six(150, DT, 100 + k, N=1.0), DT) for k in range(40)]
    log = [sums_of(six(2**15, DT, 7, N=1.0, K=0.5), DT)]
    alone, together = estimate_noise(log).figures, estimate_noise([*stills, *log]).figures
    of_stills = estimate_noise(stills).figures
    for axis in of_stills.gyro.axes:
        assert abs(axis.value("N") - 1) < 4 * axis.terms["N"].sigma
    for first, both in zip(alone.gyro.axes, together.gyro.axes, strict=True):
        assert both.terms["N"].sigma < first.terms["N"].sigma
        assert both.value("K") == pytest.approx(first.value("K"), rel=0.05)


def test_logs_whose_blocks_differ_are_both_used():
    """Clocks of 127 and 129 Hz: their blocks are of 32 and 64 samples."""
    slow, fast = sums_of(six(2**14, 1 / 127, 3, N=1.0), 1 / 127), sums_of(six(2**14, 1 / 129, 4, N=1.0), 1 / 129)
    assert slow.size != fast.size
    rests = [rest_of(slow), rest_of(fast)]
    means, none = [rest.blocks.mean[:, 0] for rest in rests], [np.zeros((len(rest.blocks), 0)) for rest in rests]
    found, *alone = (groups_of(rests[of], 0, means[of], none[of]) for of in (slice(0, 2), slice(0, 1), slice(1, 2)))
    assert sum(group.count * len(group.S) for group in found) == sum(group.count * len(group.S) for one in alone for group in one)
    for axis in estimate_noise([slow, fast]).figures.gyro.axes:
        assert abs(axis.value("N") - 1) < 4 * axis.terms["N"].sigma


def test_rates_that_differ_are_refused():
    with pytest.raises(DataError, match=r"100 and 104 Hz"):
        estimate_noise([sums_of(six(2000, DT, 1, N=1.0), DT), sums_of(six(2000, 1 / 104, 1, N=1.0), 1 / 104)])
    with pytest.raises(DataError, match="no readings at rest"):
        estimate_noise([RestSums(100.0)])
    with pytest.raises(DataError, match="do not change"):
        estimate_noise([sums_of(np.ones((5000, 6)), DT)])


def test_a_dead_accelerometer_leaves_the_gyroscope():
    values = six(2**13, DT, 2, N=1.0)
    values[:, 3:] = np.nan
    estimate = estimate_noise([sums_of(values, DT)])
    assert estimate.figures.accel is None
    assert set(estimate.figures.allan) == {"gyro"}


def test_a_line_is_no_flicker():
    values = six(2**16, DT, 3, N=1.0) + 2.0 * np.sin(2 * np.pi * 1.7 * DT * np.arange(2**16))[:, None]
    for axis in estimate_noise([sums_of(values, DT)]).figures.gyro.axes:
        assert [name for name in TERMS if axis.terms[name].chosen] == ["N"]
        (line,) = axis.lines
        assert line.hz == pytest.approx(1.7, abs=0.01)
        assert line.rms == pytest.approx(2.0 / np.sqrt(2), rel=0.1)


def test_what_is_no_noise_is_not_called_white():
    """A slow swing of the rate without its temperature: no set describes it, and N is what the fine scales say."""
    values = six(2**15, DT, 4, N=1.0) + 50 * np.cos(2 * np.pi * np.arange(2**15) / 2**14)[:, None]
    for axis in estimate_noise([sums_of(values, DT)]).figures.gyro.axes:
        assert not axis.is_described
        assert axis.value("N") == pytest.approx(1, abs=0.05)


def test_bands_of_a_right_model_have_power_one_and_of_a_wrong_one_do_not():
    rng = np.random.default_rng(0)
    basis = contrasts(64)
    walk = np.cumsum(rng.standard_normal((2000, 64)), axis=1) @ basis
    S = walk.T @ walk / len(walk)
    lag = np.minimum(np.arange(64)[:, None], np.arange(64)[None]) + 1.0
    right = _bands(basis, S, basis.T @ lag @ basis)
    assert [len(band) for band in right] == [32, 16, 8, 7]
    assert np.concatenate(right) == pytest.approx(1, abs=0.15)
    wrong = _bands(basis, S, np.eye(63))
    assert wrong[-1].mean() > 50 * wrong[0].mean()


def test_how_long_to_record_is_what_that_length_gives():
    figures = estimate_noise([sums_of(six(2**15, DT, 5, N=1.0, K=1.0), DT)]).figures
    terms = {name: (figures.gyro.axes[0].value(name), None) for name in "NK"}
    needed_s = known_after_s(figures, "gyro", 0, "K", 0.1)
    stated, length = figures.gyro.axes[0].terms["K"], figures.duration_s
    more = stated.sigma / stated.value / _relative(terms, "K", length, 1 / figures.rate_hz, 0.0)
    assert more * _relative(terms, "K", needed_s, 1 / figures.rate_hz, 0.0) == pytest.approx(0.1, rel=0.03)
    # what is stated now is known after just the present length, and a term with twice that sigma is not
    assert known_after_s(figures, "gyro", 0, "K", stated.sigma / stated.value) == pytest.approx(length, rel=0.03)
    vague = replace(figures.gyro.axes[0], terms={**figures.gyro.axes[0].terms, "K": replace(stated, sigma=2 * stated.sigma)})
    wide = replace(figures, gyro=replace(figures.gyro, axes=(vague, *figures.gyro.axes[1:])))
    assert known_after_s(wide, "gyro", 0, "K", 0.1) == pytest.approx(4 * needed_s, rel=0.1)
    assert known_after_s(figures, "gyro", 0, "K", 0.05) == pytest.approx(4 * needed_s, rel=0.1)
    white = {"N": (1.0, None)}
    assert _relative(white, "N", 1000.0, DT, 0.0) == pytest.approx(1 / np.sqrt(2 * 1000 / DT), rel=0.02)


# What is found out and said.


def test_readings_that_are_missing_do_not_make_n_larger():
    values = six(2**15, DT, 12, N=1.0)
    kept = np.random.default_rng(0).random(2**15) > 0.1
    whole = samples_of(values, DT)
    sums = RestSums(90.0)
    sums.add(Samples(whole.t_ns[kept], whole.gyro[kept], whole.accel[kept], None))
    estimate = estimate_noise([sums])
    assert sums.lost == pytest.approx(0.11, abs=0.01)
    assert sums.period_s == pytest.approx(DT, rel=1e-9)
    assert estimate.said[0].startswith("10 % of the readings are missing")
    for axis in estimate.figures.gyro.axes:
        assert abs(axis.value("N") - 1) < 3.5 * axis.terms["N"].sigma
    jittered = RestSums(100.0)  # stamps that are no multiples of one period tell nothing of losses
    jitter = np.random.default_rng(1).integers(-4_000_000, 4_000_000, 2**15)
    jittered.add(Samples(whole.t_ns + jitter, whole.gyro, whole.accel, None))
    assert jittered.lost == 0


def test_what_is_wrong_with_a_rest_is_said():
    values = six(2**15, DT, 13, N=1.0)
    still = values.copy()
    still[8000:16_000, 1] = still[8000, 1]
    assert any(line.startswith("Readings stand still: 80 s") for line in estimate_noise([sums_of(still, DT)]).said)
    louder = values.copy()
    louder[20_000:] *= 1.5
    assert any("not steady" in line for line in estimate_noise([sums_of(louder, DT)]).said)
    coarse = np.round(values / 30) * 30
    assert any("moves over 3 steps" in line for line in estimate_noise([sums_of(coarse, DT)]).said)
    dead = values.copy()
    dead[:, 4] = 9.81
    estimate = estimate_noise([sums_of(dead, DT)])
    assert estimate.figures.accel is None
    assert any(line.startswith("accel y: its readings do not change") for line in estimate.said)
    dead[:, 1] = 0.0
    with pytest.raises(DataError, match="axis y"):
        estimate_noise([sums_of(dead, DT)])
    both = estimate_noise([sums_of(values, DT), sums_of(1.3 * six(2**15, DT, 14, N=1.0), DT)])
    assert any("log 2 is 1.3 times as noisy as log 1" in line for line in both.said)
    assert estimate_noise([sums_of(values, DT)]).said == ()


def test_a_misfit_widens_sigmas_and_a_change_of_n_is_in_its_sigma():
    rest = rest_of(sums_of(six(2**13, DT, 15, N=1.0, G=3.0, T=2.0), DT))
    groups = groups_of([rest], 0, [rest.blocks.mean[:, 0]], [np.zeros((len(rest.blocks), 0))])
    search = Search(groups, DT)
    chosen = search.of(frozenset("G"))
    plain, wide = (described(search, chosen, p, 1.44, 0.0, 0.0) for p in (0.5, 1e-4))
    widths = np.sqrt(np.diag(sandwich(search, chosen)) / np.diag(chosen.fitted.covariance))
    for k, name in enumerate("NG"):
        for axis, times in ((plain, 1.0), (wide, 1.2)):
            assert (axis.value(name), axis.terms[name].sigma) == pytest.approx(search.average(name, times * widths[k])[:2], rel=1e-9)
    assert wide.terms["G"].tau_sigma_s == pytest.approx(1.2 * plain.terms["G"].tau_sigma_s)
    log_sigma = np.sqrt(np.diag(sandwich(search, chosen)))
    assert plain.terms["G"].tau_sigma_s == pytest.approx(plain.terms["G"].tau_s * log_sigma[-1], rel=1e-9)
    changed = described(search, chosen, 0.5, 1.0, 0.0, 0.3)
    assert changed.terms["N"].sigma == pytest.approx(np.hypot(plain.terms["N"].sigma, 0.3 * plain.value("N")), rel=1e-9)
    assert changed.terms["G"].sigma == plain.terms["G"].sigma


def of_sizes(present, log_sigma):
    """An axis whose sets have a K of size 2 with a sigma of its logarithm, and have it with a probability."""
    rest = rest_of(sums_of(six(2**12, DT, 17, N=1.0, K=2.0), DT))
    groups = groups_of([rest], 0, [rest.blocks.mean[:, 0]], [np.zeros((len(rest.blocks), 0))])
    search = Search(groups, DT)
    both, none = search.of(frozenset("K")), search.of(frozenset())
    width = sandwich(search, both)[1, 1] / both.fitted.covariance[1, 1]
    information = np.diag([1e4, width / (2 * log_sigma) ** 2]) - np.eye(2) / PRIOR_VARIANCE
    chosen = replace(both, fitted=replace(both.fitted, x=np.array([1.0, 4.0]), information=information), log_evidence=0.0)
    search.tried = {frozenset("K"): chosen}
    if present < 1:
        search.tried[frozenset()] = replace(none, log_evidence=-float(np.log(ODDS * present / (1 - present))))
    return described(search, chosen, 0.5, 1.0, 0.0, 0.0).terms["K"]


#: of a number, of a limit alone, and of a term that does not show
SURE, VAGUE, NONE = Term(6.0, 0.6, 1.0), Term(2.0, 1.2, 0.7, 4.0), Term(0.0, None, 0.1, 3.0)


def test_a_size_within_two_sigmas_of_none_is_a_limit_alone():
    sure = of_sizes(1.0, 0.1)
    assert sure.is_determined
    assert sure.value == pytest.approx(2, rel=0.02)
    assert sure.at_most is None
    unsure = of_sizes(0.7, 0.1)  # sd / mean = 0.67
    assert unsure.chosen
    assert not unsure.is_determined
    assert unsure.value == pytest.approx(1.4, rel=0.02)
    assert unsure.at_most == pytest.approx(2 * 1.155, rel=0.05)
    assert of_sizes(0.9, 0.1).is_determined  # 0.35
    assert not of_sizes(1.0, 0.6).is_determined


@pytest.mark.parametrize(
    ("B", "K", "is_said"), [(VAGUE, VAGUE, True), (VAGUE, NONE, True), (SURE, VAGUE, False), (VAGUE, SURE, False), (NONE, NONE, False)]
)
def test_b_is_said_to_be_hidden_in_k_only_where_neither_is_a_number(monkeypatch, B, K, is_said):
    found = AxisNoise({**dict.fromkeys(TERMS, NONE), "N": SURE, "B": B, "K": K})
    monkeypatch.setattr("tinygc.annexes.noise.estimate._axis", lambda *of: found)
    said = estimate_noise([sums_of(six(2**13, DT, 5, N=1.0), DT)]).said
    assert any("does not tell B from K" in line for line in said) == is_said


def test_b_is_not_taken_from_a_log_whose_temperature_moves_the_zero_by_more():
    count = 2**15
    temp_c = 30 - 10 * np.cos(2 * np.pi * np.arange(count) / (count / 2))
    values = six(count, DT, 5, N=1.0, B=2.0)
    moved = estimate_noise([sums_of(values + 5.0 * (temp_c - 30)[:, None], DT, temp_c)])
    alike = estimate_noise([sums_of(values, DT, temp_c)])
    assert any("of B there is a limit alone: the error of temperature's law is in it" in line for line in moved.said)
    assert not any("a limit alone" in line for line in alike.said)
    for axis in (axis for sensor in moved.figures.sensors().values() for axis in sensor.axes):
        term = axis.terms["B"]
        assert not term.is_determined
        if term.chosen:
            assert term.at_most == pytest.approx(term.value + 1.645 * term.sigma)
    assert any(axis.terms["B"].is_determined for axis in alike.figures.gyro.axes)
    shown = next(k for k, axis in enumerate(moved.figures.gyro.axes) if axis.terms["B"].chosen)
    assert known_after_s(moved.figures, "gyro", shown, "B") == np.inf


def test_a_ramp_is_a_slope_with_the_sigma_of_least_squares():
    values = six(2**12, DT, 16, N=1.0) + 0.5 * DT * np.arange(2**12)[:, None]
    t = DT * np.arange(2**12)
    by_hand = 1 / np.sqrt(DT * np.sum((t - t.mean()) ** 2))
    for k, axis in enumerate(estimate_noise([sums_of(values, DT)]).figures.gyro.axes):
        slope = np.polyfit(t, values[:, k], 1)[0]
        assert axis.value("R") == pytest.approx(slope, abs=0.1 * by_hand)
        assert axis.terms["R"].sigma == pytest.approx(by_hand, rel=0.05)


def test_temperature_is_taken_out_of_fine_scales_and_costs_the_coarsest_its_columns():
    count = 2**15
    temp_c = 30 + 20 * np.sin(2 * np.pi * np.arange(count) / count)
    fast = 40.0 * (temp_c - 30)[:, None]
    sums = sums_of(six(count, DT, 17, N=1.0) + fast, DT, temp_c)
    rest = rest_of(sums)
    part = temperature_part([rest], 0, knots_of([rest]))
    assert part.order >= 1
    raw, less = (
        groups_of([rest], 0, [means], [columns])
        for means, columns in (
            (rest.blocks.mean[:, 0], np.zeros((len(rest.blocks), 0))),
            (part.residuals[0], part.columns[0]),
        )
    )
    assert less[-1].basis.shape[1] == raw[-1].basis.shape[1] - part.order
    level = {group.size: group for group in less}
    before = {group.size: group for group in raw}
    size = sorted(level)[1]
    white = level[size].count * len(level[size].S) / (size * DT)
    assert np.trace(before[size].S) > 1.1 * white
    assert np.trace(level[size].S) == pytest.approx(white, rel=0.04)
    assert knots_of([rest_of(sums_of(six(2000, DT, 1, N=1.0), DT, np.full(2000, 25.0)))]) is None
    assert knots_of([rest_of(sums_of(six(2**13, DT, 1, N=1.0), DT, np.linspace(25, 25.9, 2**13)))]) is None
    assert knots_of([rest_of(sums_of(six(2**13, DT, 1, N=1.0), DT, np.linspace(25, 26.2, 2**13)))]) is not None


# A curve that somebody else made.


def test_an_exact_curve_gives_back_its_terms():
    tau_s = np.logspace(-1, 3.5, 60)
    variance = sum(size**2 * unit_allan_variance(name, tau_s) for name, size in {"N": 1.0, "B": 0.4, "K": 0.02}.items())
    (axis,) = fit_curve(tau_s, np.sqrt(variance)[:, None], 70_000.0)
    assert [name for name in TERMS if axis.terms[name].chosen] == ["N", "B", "K"]
    for name, size in {"N": 1.0, "B": 0.4, "K": 0.02}.items():
        assert axis.value(name) == pytest.approx(size, rel=0.02)


def test_a_curve_of_three_octaves_is_refused():
    with pytest.raises(DataError, match="octaves"):
        fit_curve(np.array([1.0, 2.0, 4.0]), np.ones((3, 1)), 1000.0)


# Real rests.

#: degrees per root hour, and degrees per hour per root hour, of a separate analysis (../shared/wild/README.md)
STATED = {
    1: {"N": (2.41, 2.54, 2.29), "K": (24, 119, 178)},
    2: {"K": (107, 128, 177)},
    3: {"K": (0, 9, 98)},
}


@pytest.mark.broad
@pytest.mark.parametrize("unit", STATED)
def test_three_units_at_rest_agree_with_a_separate_analysis(unit, shared):
    log = np.load(shared / "wild" / f"adis16405_imu{unit}.npz")
    values = np.column_stack([log["gyro_dps"] * DEG, log["accel_g"] * G])
    found = estimate_noise([sums_of(values, 1 / float(log["rate_hz"]))]).figures.gyro
    per_hour = DEG / 3600
    for axis, stated in zip(found.axes, zip(*STATED[unit].values(), strict=True), strict=True):
        for name, value in zip(STATED[unit], stated, strict=True):
            term = axis.terms[name]
            size = value * (DEG / 60 if name == "N" else per_hour / 60)
            if term.chosen:  # the separate analysis states no sigma: two percent of N, for where its fit began
                assert abs(term.value - size) < 2 * np.hypot(term.sigma, 0.02 * size if name == "N" else 0.0)
            else:
                assert size < term.at_most


def test_a_published_curve_gives_the_published_densities(shared):
    table = np.loadtxt(shared / "wild" / "d455_allan.csv")
    deviation = table[:, 1:] * np.array([1, 1, 1, DEG, DEG, DEG])
    axes = fit_curve(table[:, 0], deviation, 20.5 * 3600)
    white, walk = (np.mean([axis.value(name) for axis in axes[3:]]) for name in "NK")
    assert white == pytest.approx(1.0272e-4, rel=0.15)
    equivalent = [max(axis.value("K"), axis.value("G") * np.sqrt(2 / (axis.terms["G"].tau_s or 1))) for axis in axes[3:]]
    assert max(walk, float(np.mean(equivalent))) == pytest.approx(1.1106e-6, rel=0.4)
