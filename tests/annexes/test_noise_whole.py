"""``noise`` from a file to its numbers: white noise that is put into a log comes out, by whatever way the log is read."""

import json

import numpy as np
import pytest
from conftest import DEG, Table, write_session

from session.io.units import G
from tinygc.noise.figures import read_figures

pytest.importorskip("tinygc.annexes.noise.likelihood", reason="the estimator is not there")

#: one-sided densities, mdps and ug per √Hz, that no register hides
GYRO, ACCEL = 20.0, 240.0
N = {"gyro": GYRO * 1e-3 * DEG / np.sqrt(2), "accel": ACCEL * 1e-6 * G / np.sqrt(2)}


@pytest.mark.broad
@pytest.mark.parametrize("way", ["rest log", "stills", "arrays in a file", "text"])
def test_white_noise_comes_out_as_it_went_in(way, tmp_path, run):
    table = Table().tumble(12, rest_s=4.0, seed=4) if way == "stills" else Table().rest(120)
    samples = table.samples(gyro_mdps=GYRO, accel_ug=ACCEL, seed=8, registers=way in ("rest log", "stills"))
    given = [tmp_path / "log.npz"]
    if way == "arrays in a file":
        np.savez(given[0], gyro_dps=samples.gyro / DEG, accel_g=samples.accel / G, rate_hz=208.0)
    elif way == "text":
        given = [tmp_path / "log.csv", "--columns", "t_us=clock,gx_dps=a,gy_dps=b,gz_dps=c,ax_g=d,ay_g=e,az_g=f", "--time-unit", "us"]
        rows = np.column_stack([samples.t_ns // 1000, samples.gyro / DEG, samples.accel / G])
        np.savetxt(given[0], rows, fmt=["%d", *["%.9f"] * 6], delimiter=",", header="clock,a,b,c,d,e,f", comments="")
    else:
        given = [write_session(tmp_path / "session", samples, "rest0001.csv" if way == "rest log" else "log0001.csv")]
    code, _, err = run("noise", *given, "--out", tmp_path / "out", "--no-pictures")
    assert code == 0, err
    figures = read_figures(tmp_path / "out" / "noise.json")
    assert figures.rate_hz == pytest.approx(208, rel=1e-3)
    for kind, sensor in figures.sensors().items():
        for axis in sensor.axes:
            term = axis.terms["N"]
            assert term.sigma < 0.05 * term.value
            assert abs(term.value - N[kind]) < 4 * term.sigma
    # one-sided and two-sided, as the page says
    table = json.loads((tmp_path / "out" / "noise.json").read_text())
    assert table["kalibr"]["gyroscope_noise_density"] == pytest.approx(N["gyro"], rel=0.1)
    sheet = [row for row in table["data_sheet"] if row["term"] == "N"]
    assert [row["value"] for row in sheet] == pytest.approx([GYRO, ACCEL][: len(sheet)], rel=0.1)
