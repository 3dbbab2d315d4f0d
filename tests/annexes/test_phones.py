"""Two telephones on a stepper's table: the authors' files as folders, and what is known of their gyroscopes."""

import numpy as np
import pytest

import tinygc
from benchmarks.public.__main__ import main
from session.io.units import DEG


@pytest.fixture(scope="session")
def authors_files(shared):
    """The authors' folders; a test that needs them skips where they are missing."""
    files = shared / "wild" / "phones"
    if not files.is_dir():
        pytest.skip(f"{files}: not there")
    return files


@pytest.fixture(scope="module")
def fits(tmp_path_factory, authors_files):
    """A fit of each telephone."""
    out = tmp_path_factory.mktemp("phones")
    assert main(["phones", str(authors_files), "--out", str(out)]) == 0
    return {name: tinygc.fit_turns(out / name) for name in ("IphoneSE3G", "SamsungS10")}


def test_scales_are_those_of_the_long_turns(fits):
    """1800 deg at some 530 dps, as anyone may integrate them: -0.2, 0.9, 0.3 %, and 1.07, 0.61, 1.0 %."""
    for name, expected in (("IphoneSE3G", (-0.24, 0.91, 0.30)), ("SamsungS10", (1.07, 0.61, 0.96))):
        found = fits[name]
        assert [(scale.axis, scale.sense) for scale in found.scales] == [(0, 1), (1, 1), (2, 1)]
        for scale, percent in zip(found.scales, expected, strict=True):
            assert abs(100 * scale.value - percent) < 3 * 100 * scale.sigma
            assert scale.sigma < 1e-3
        assert found.asymmetry == {}


def test_short_and_long_turns_of_the_s10_agree(fits):
    """Ten turns about z, of 90 to 1800 deg at 10 to 540 dps: what its sigmas state is what is left."""
    found = fits["SamsungS10"]
    assert found.estimate.p_value > 0.01
    assert found.estimate.play.upper < 0.3 * DEG
    assert found.estimate.used.all()
    assert all(log.times.bursts for log in found.logs)
    (gap,) = [angle for angle in found.angles if angle.lost_s]
    assert (gap.axis, round(gap.stated_rad / DEG)) == (2, 1800)
    assert gap.lost_s == pytest.approx(0.155, abs=0.02)


def test_the_iphone_repeats_worse_than_the_table_can(fits):
    """Its 50 to 60 Hz do not follow the motor's steps; the S10's 500 Hz on the same table do."""
    play = {name: found.estimate.play for name, found in fits.items()}
    assert play["IphoneSE3G"].low > 0.5 * DEG > play["SamsungS10"].upper
    assert fits["IphoneSE3G"].estimate.p_value < 1e-6
    cells = {(cell["axis"], round(cell["stated_deg"])): cell for cell in fits["IphoneSE3G"].to_json()["repeats"]}
    assert cells["z", 1800]["turns"] == 6
    assert 1 < cells["z", 1800]["std_deg"] < 2.5


def test_three_turns_that_seemed_to_lack_tens_of_degrees_lack_none(fits, authors_files):
    """Integrated over the step back to the repeated second, they read 300, 139 and 64 deg; none has lost a sample, nor the table a step."""
    found = fits["IphoneSE3G"]
    assert found.estimate.used.all()
    doubtful = [angle.log for angle, lost in zip(found.angles, found.estimate.lost, strict=True) if lost > 0.01]
    assert doubtful in ([], ["log_YG_1_360_1.csv.gz"])  # it reads 370 deg
    for name, stated, wrong in (("ZG_2_360_1", 360, 300), ("ZG_2_180_2", 180, 139), ("ZG_2_90_1", 90, 64)):
        (path,) = authors_files.rglob(f"IphoneSE3G_{name}.csv")
        t_s, rate = np.loadtxt(path, delimiter=",", skiprows=1, usecols=(0, 3), unpack=True)
        assert np.trapezoid(rate, t_s) / DEG == pytest.approx(wrong, abs=2)
        (angle,) = [angle for angle in found.angles if angle.log == f"log_{name}.csv.gz"]
        assert angle.measured_rad / DEG == pytest.approx(stated, abs=1.5)
        assert angle.lost_s == 0


def test_all_turns_are_found_with_a_rest_on_either_side_and_in_the_positive_sense(fits):
    for found in fits.values():
        assert all(angle.problem is None and angle.sense == 1 for angle in found.angles)
        assert all(angle.lean_rad < 4 * DEG for angle in found.angles)
    assert {name: len(found.angles) for name, found in fits.items()} == {"IphoneSE3G": 60, "SamsungS10": 12}
