"""Any program's logs of a gyroscope alone, imported with the known angles of their turns."""

import numpy as np
import pytest
from annex import annex
from conftest import ROOT
from turntables import Turned
from written_texts import lines

import tinygc

annex("session.annexes.turntable.importing")
PHONES = ROOT.parent / "shared" / "wild" / "phones"
GAIN = 0.004
TURNED = Turned(((2, 360, 90.0), (2, -360, 90.0), (2, 360, 90.0)), plus=(0, 0, GAIN), minus=(0, 0, GAIN), noise=0.002, stop_deg=0.02)


def phone(path, turned=TURNED, repeated=0):
    t_ns, gyro = turned.arrays()
    text = lines(t_ns * 1e-9, *gyro.T, digits=6).splitlines()
    path.write_text("\n".join(["time,wx,wy,wz", *text, *(text[-repeated:] if repeated else [])]) + "\n")
    return path


def turns_file(path, *logs, turned=TURNED):
    rows = [f"{i},{'xyz'[axis]},{angle},0.02,{log}" for log in logs for i, (axis, angle, _) in enumerate(turned.plan)]
    path.write_text("\n".join(["turn,axis,angle_deg,sigma_deg,log", *rows]) + "\n")
    return path


@pytest.mark.parametrize("repeated", [0, 60])
def test_logs_keep_the_names_that_the_file_of_turns_has(repeated, tmp_path, run):
    """Two telephones' files; rows that stand twice at their ends are left out."""
    paths = [phone(tmp_path / name, repeated=repeated) for name in ("Z_90_1.csv", "Z_90_2.csv")]
    turns = turns_file(tmp_path / "turns.csv", "Z_90_1.csv", "Z_90_2.csv")
    assert run("import", *paths, "--turns", turns, "--out", tmp_path / "s")[0] == 0
    found = tinygc.fit_turns(tmp_path / "s")
    assert [angle.log for angle in found.angles] == ["log0001_Z_90_1.csv.gz"] * 3 + ["log0002_Z_90_2.csv.gz"] * 3
    assert [scale.sense for scale in found.scales] == [1, -1]
    for scale in found.scales:
        assert scale.value == pytest.approx(GAIN, abs=4 * scale.sigma)
        assert scale.sigma < 3e-4


def test_registers_and_logs_without_turns_are_refused_in_one_line(tmp_path, run):
    path = phone(tmp_path / "a.csv")
    code, _, said = run("import", path, "--out", tmp_path / "s")
    assert code == 2
    assert "--turns FILE" in said
    turns = turns_file(tmp_path / "turns.csv", "b.csv")
    code, _, said = run("import", path, "--turns", turns, "--out", tmp_path / "s")
    assert (code, said.count("\n")) == (2, 1)
    assert "log is 'b.csv', expected one of a.csv" in said
    raw = tmp_path / "raw.csv"
    raw.write_text("t_us,gx,gy,gz\n" + lines(np.arange(0, 10**6, 10**4), *np.ones((3, 100), dtype=int)))
    code, _, said = run("import", raw, "--turns", turns_file(tmp_path / "t2.csv", "raw.csv"), "--out", tmp_path / "s")
    assert (code, said.count("\n")) == (2, 1)
    assert "give what one count is" in said
    assert not (tmp_path / "s").exists()


@pytest.mark.skipif(not PHONES.exists(), reason="the public recordings are not beside the project")
def test_a_real_telephone_reads_as_the_public_set_does(tmp_path, run):
    """Six turns of 1800° about each axis: the scales that are published of them, and one sense only."""
    paths = sorted((PHONES / "IphoneSE3G" / "Rotation" / "10" / "1800").glob("*.csv"))
    rows = [f"0,{path.name.split('_')[1][0].lower()},1800,0.26,{path.name}" for path in paths]
    (tmp_path / "turns.csv").write_text("\n".join(["turn,axis,angle_deg,sigma_deg,log", *rows]) + "\n")
    assert run("import", *paths, "--turns", tmp_path / "turns.csv", "--out", tmp_path / "s")[0] == 0
    found = tinygc.fit_turns(tmp_path / "s")
    assert [(scale.axis, scale.sense, scale.turns) for scale in found.scales] == [(0, 1, 6), (1, 1, 6), (2, 1, 6)]
    for scale, published in zip(found.scales, (-0.002, 0.009, 0.003), strict=True):
        assert abs(scale.value - published) < 0.001
    assert found.asymmetry == {}


def test_two_files_of_one_name_and_a_wrong_file_of_turns_are_refused(tmp_path, run):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        phone(tmp_path / name / "Z.csv")
    turns = turns_file(tmp_path / "mine.csv", "Z.csv")
    code, _, said = run("import", tmp_path / "a" / "Z.csv", tmp_path / "b" / "Z.csv", "--turns", turns, "--out", tmp_path / "s")
    assert (code, said.count("\n")) == (2, 1)
    assert "two files are called Z.csv" in said
    turns.write_text(turns.read_text().replace("360", "north", 1))
    code, _, said = run("import", tmp_path / "a" / "Z.csv", "--turns", turns, "--out", tmp_path / "s")
    assert (code, said.count("\n")) == (2, 1)
    assert "mine.csv line 2: angle_deg" in said
