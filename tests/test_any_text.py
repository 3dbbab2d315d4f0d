"""Text logs of many programs hold the samples that were written into them, whatever their form."""

import numpy as np
import pytest
from conftest import Table
from written_texts import TEXTS

import calibrate
from tinygc import read_session

SAMPLES = Table().tumble(2, rest_s=2.0).samples(odr_hz=104)


@pytest.mark.parametrize("name", TEXTS)
def test_the_samples_are_those_that_were_written(name, tmp_path, capsys):
    text = TEXTS[name]
    paths = []
    for called, data in text.write(SAMPLES):
        paths.append(tmp_path / called)
        paths[-1].write_bytes(data)
    code = calibrate.main(["import", *map(str, paths), "--out", str(tmp_path / "made"), *text.options])
    assert code == 0, capsys.readouterr().err
    (log,) = read_session(tmp_path / "made").logs
    assert len(log.samples) >= len(SAMPLES) - 1
    few = len(log.samples)
    t_s = (log.samples.t_ns - log.samples.t_ns[0]) * 1e-9
    np.testing.assert_allclose(t_s, (SAMPLES.t_ns - SAMPLES.t_ns[0])[:few] * 1e-9, rtol=0, atol=text.exact_s)
    np.testing.assert_allclose(log.samples.gyro, SAMPLES.gyro[:few], rtol=0, atol=0.51 * text.gyro_lsb)
    np.testing.assert_allclose(log.samples.accel, SAMPLES.accel[:few], rtol=0, atol=0.51 * text.accel_lsb)
    took = capsys.readouterr().out.splitlines()[1:4]
    assert [line.split(":")[0].strip() for line in took[1:]] == ["gyroscope", "clock"]
