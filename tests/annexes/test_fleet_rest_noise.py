"""Noise at rest of a fleet: which figures are taken, the spread between units, and the key of a result that used them."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from noise_records import axis_of, figures_of

from tinygc.annexes.lots.fleet_row import FleetOptions, key_of
from tinygc.annexes.lots.rest_noise import noise_section, spread_between, unit_noises
from tinygc.noise.figures import SensorNoise, to_json
from tinygc.noise.measured import rms_of_axes

N = DEG / 60


def figures(**terms):
    axis = axis_of(**terms)
    return figures_of(SensorNoise((axis, axis, axis)))


def session(folder: Path, noise: str | None) -> Path:
    folder.mkdir()
    (folder / "session.toml").write_text("")
    if noise is not None:
        (folder / "fit").mkdir()
        (folder / "fit" / "noise.json").write_text(noise)
    return folder


def test_a_spread_is_without_the_measurement_s_share():
    """Of 4000 units that differ by 10 % and are measured to 8 %, and of units that do not differ."""
    rng = np.random.default_rng(3)
    values = 0.3 * np.exp(0.1 * rng.normal(size=4000) + 0.08 * rng.normal(size=4000))
    assert spread_between(values, np.full(4000, 0.08)) == pytest.approx(0.1, rel=0.05)
    assert spread_between(np.array([1.0, 1.01, 0.99]), np.full(3, 0.05)) == 0.0
    assert spread_between(np.exp([0.0, 0.2, 0.4]), np.zeros(3)) == pytest.approx(0.2, rel=1e-12)


def test_the_last_figures_of_a_unit_count_and_broken_ones_do_not(tmp_path):
    first, last = (json.dumps(to_json(figures(N=(value * N, 0.01 * N)))) for value in (0.2, 0.3))
    folders = [session(tmp_path / f"s{i}", noise) for i, noise in enumerate((first, last, None, "{", first))]
    serials = ("A", "A", "A", "B", "")
    opened = SimpleNamespace(each=lambda sql: zip(serials, map(str, folders), strict=True))
    found = [rms_of_axes(unit.gyro, "N") for unit in unit_noises(opened)]
    assert found == [(pytest.approx(value * N), pytest.approx(0.01 / value / np.sqrt(3))) for value in (0.3, 0.2)]


def test_the_section_has_medians_and_spreads():
    units = [figures(N=(value * N, 0.003 * N)) for value in (0.2, 0.3, 0.45)]
    section = noise_section(units)
    assert "<td>3</td><td>0.300</td>" in section.html
    spread = spread_between(np.array([0.2, 0.3, 0.45]), 0.003 / np.array([0.2, 0.3, 0.45]) / np.sqrt(3))
    assert f"<td>{100 * spread:.0f} %</td>" in section.html
    assert noise_section([]) is None
    assert " %" not in noise_section(units[:2]).html  # two units are no spread


def test_a_result_that_used_other_figures_is_another(tmp_path):
    folder = session(tmp_path / "s", None)
    without = key_of(folder, FleetOptions())
    (folder / "fit").mkdir()
    (folder / "fit" / "fit.json").write_text("{}")
    assert key_of(folder, FleetOptions()) == without
    keys = {without}
    for text in ("{}", "{ }"):
        (folder / "fit" / "noise.json").write_text(text)
        keys.add(key_of(folder, FleetOptions()))
    assert len(keys) == 3
