"""Sums of a rest: the same whatever the pieces; gaps, joins and tails; what is left out."""

import numpy as np
import pytest
from resting import samples_of, six, sums_of
from scipy.special import ndtri

from session.io.errors import DataError
from session.io.samples import Samples
from tinygc.annexes.noise import summary
from tinygc.annexes.noise.scales import above_chance, groups_of, left_out, rest_of, unsteady
from tinygc.annexes.noise.summary import RestSums, contrasts, ratios_of

DT = 0.01


def groups(sums, channel=0):
    rest = rest_of(sums)
    return groups_of([rest], channel, [rest.blocks.mean[:, channel]], [np.zeros((len(rest.blocks), 0))])


@pytest.mark.parametrize("count", [2, 3, 8, 16])
def test_contrasts_are_orthonormal_and_have_no_mean(count):
    H = contrasts(count)
    assert np.allclose(H.T @ H, np.eye(count - 1), atol=1e-14)
    assert np.allclose(H.sum(axis=0), 0, atol=1e-14)


@pytest.mark.parametrize("samples", [16, 32, 64, 128, 512, 8192])
def test_the_windows_of_the_levels_lead_to_a_block(samples):
    assert np.prod(ratios_of(samples)) == samples
    assert max(ratios_of(samples)) <= summary.MOST_WINDOW


def test_the_finest_sums_are_those_of_all_windows():
    values = six(6400, DT, 1, N=1.0, K=0.3)
    sums = sums_of(values, DT)
    found = groups(sums, 2)[0]
    z = (values[:, 2] - values[0, 2]).reshape(-1, sums.ratios[0]) @ contrasts(sums.ratios[0])
    assert found.count == len(z)
    assert np.allclose(found.S, z.T @ z, rtol=1e-12)


@pytest.mark.parametrize("piece", [7, 63, 1000, 4096])
def test_pieces_do_not_matter(piece):
    values = six(9000, DT, 2, N=1.0, K=0.3)
    at_once, by_pieces = sums_of(values, DT), RestSums(1 / DT)
    for start in range(0, len(values), piece):
        by_pieces.add(samples_of(values[start : start + piece], DT, start_s=start * DT))
    for one, other in zip(groups(at_once), groups(by_pieces), strict=True):
        assert (one.size, one.count) == (other.size, other.count)
        assert np.allclose(one.S, other.S, rtol=1e-10)
    assert by_pieces.period_s == pytest.approx(DT, rel=1e-9)
    assert by_pieces.duration_s == pytest.approx(8999 * DT)


def test_joined_chunks_hold_the_same_sums(monkeypatch):
    values = six(40_000, DT, 3, N=1.0)
    whole = groups(sums_of(values, DT))
    monkeypatch.setattr(summary, "MOST_CHUNKS", 16)
    sums = sums_of(values, DT)
    assert len(sums.ended()[2]) <= 16 + 1
    for one, other in zip(whole, groups(sums), strict=True):
        assert one.count == other.count
        assert np.allclose(one.S, other.S, rtol=1e-10)


def test_no_window_spans_a_gap_and_the_coarsest_vector_keeps_its_time():
    values = six(12_800, DT, 4, N=1.0)
    values[6400:] += 100.0  # what a window across the gap would hold
    sums = RestSums(1 / DT)
    sums.add(samples_of(values[:6400], DT))
    sums.add(samples_of(values[6400:], DT, start_s=64.0 + 32.0))
    found = groups(sums)
    assert found[0].count == 12_800 / sums.ratios[0]
    assert max(np.diag(found[0].S)) / found[0].count < 2 / DT
    blocks = rest_of(sums).blocks
    assert blocks.number[-1] - blocks.number[0] == 399 + 100
    assert sums.duration_s == pytest.approx(128, abs=0.05)


def test_a_ramp_is_exact_where_the_last_mean_lacks_a_part():
    count = 32 * 1023  # the last of the coarsest means has 15 of its 16 blocks
    values = np.repeat((np.arange(count) * 0.01)[:, None], 6, axis=1) + 1e-6 * six(count, DT, 1, N=1.0)
    top = groups(sums_of(values, DT))[-1]
    assert top.top
    t = top.t() * top.size * 0.01
    assert top.middle[-1] == pytest.approx(top.at[-1] - 1 / 64, abs=1e-9)
    assert np.sqrt(np.trace(top.S)) == pytest.approx(np.linalg.norm(t), rel=1e-6)


def test_what_is_shorter_than_a_block_counts_at_the_levels_that_it_fills():
    sums = sums_of(six(40, DT, 5, N=1.0), DT)
    assert sums.size == 32
    short = sums_of(six(31, DT, 5, N=1.0), DT)
    assert [group.size for group in groups(short)] == [1]
    assert groups(short)[0].count == 31 // short.ratios[0]


def test_the_limit_of_a_peak_is_that_of_gaussian_noise():
    rng = np.random.default_rng(11)
    peaks = np.abs(rng.standard_normal((40_000, 32))).max(axis=1)
    none = np.zeros(len(peaks), bool)
    assert not above_chance(peaks, none, 32).any()
    far = -ndtri(1e-3 / (2 * 32 * len(peaks)))
    assert far == pytest.approx(6.15, abs=0.01)
    peaks[:2] = 1.2 * far, 1.3 * far
    assert above_chance(peaks, none, 32)[:2].tolist() == [False, True]


def test_a_knock_a_stuck_register_and_a_noisy_spell_are_left_out():
    values = six(60_000, DT, 7, N=1.0)
    values[10_000:10_008] += 200.0
    values[30_000:30_400] = values[30_000]
    values[45_000:47_000, 4] *= 2
    rest = rest_of(sums_of(values, DT))
    number = rest.blocks.number[rest.bad] * 32
    assert set(np.arange(10_016 // 32, 10_000 // 32 + 1) * 32) <= {*number}
    assert np.count_nonzero((number >= 30_016) & (number < 30_368)) == 11
    assert np.count_nonzero((number >= 45_000) & (number < 46_960)) >= 60
    assert len(number) < 140
    assert [line.split(":")[0] for line in left_out([rest])] == ["Readings stand still", "Knocks", "Spells noisier than the rest"]
    assert "(from 99.52 s on)" in left_out([rest])[1]
    assert sum(rest.seconds.values()) == pytest.approx(len(number) * rest.block_s)
    clean = groups(sums_of(values, DT), 4)[0]
    assert np.trace(clean.S) / clean.count / len(clean.S) * DT == pytest.approx(1, abs=0.03)


def test_halves_that_differ_are_said():
    quiet, loud = six(30_000, DT, 8, N=1.0), six(30_000, DT, 9, N=1.0, K=2.0)
    loud += quiet[-1] - loud[0]
    rest = rest_of(sums_of(np.concatenate([quiet, loud]), DT))
    (line,) = unsteady([rest], [rest.blocks.mean[:, 0]], DT)
    assert "the noise of its second half is" in line
    same = rest_of(sums_of(six(60_000, DT, 10, N=1.0, K=1.0), DT))
    assert unsteady([same], [same.blocks.mean[:, 0]], DT) == []


def test_bad_input_is_refused():
    values = six(100, DT, 1, N=1.0)
    values[50, 1] = np.nan
    with pytest.raises(DataError, match="no numbers"):
        sums_of(values, DT)
    with pytest.raises(DataError, match="data rate"):
        RestSums(0.0)
    RestSums(100.0).add(Samples(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), None))
