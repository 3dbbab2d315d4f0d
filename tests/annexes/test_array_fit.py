"""An array's units estimated together: what others tell of a unit, what the command says and saves, and what is left out."""

import dataclasses
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from formats_page import strangers
from scipy.linalg import eigh

import calibrate
from session.annexes.arrays.recording import read_array
from session.io.texts import shell_word
from tinygc import SimulationOptions
from tinygc.annexes.arrays.explanation import ArrayExplanation, event_lines
from tinygc.annexes.arrays.fit import array_to_json, fit_array
from tinygc.annexes.arrays.joint import ArrayEvent
from tinygc.annexes.arrays.model import load_array_model
from tinygc.annexes.arrays.options import ArrayOptions
from tinygc.annexes.arrays.simulation import simulate_array, write_array
from tinygc.explanation.standing import Standing


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """``made(units=3, seed=1, …)``: a simulated array, the folder that holds it, and its fit; each once."""
    known = {}

    def make(bias="ends", segments=12, seed=0, units=3, **more):
        key = (bias, segments, seed, units, *sorted(more.items()))
        if key not in known:
            simulation = simulate_array(
                SimulationOptions(segments=segments, closure_s=0, odr_hz=62.5, seed=seed), ArrayOptions(units=units, **more)
            )
            folder = write_array(simulation, tmp_path_factory.mktemp("array") / "array")
            known[key] = simulation, folder, fit_array(read_array(folder), bias=bias)
        return known[key]

    return make


def test_other_units_tell_what_gravity_alone_does_not(made):
    _, _, fit = made()
    for unit in fit.units:
        assert (unit.sigma[:9] < unit.sigma_alone[:9]).all()
        assert eigh(unit.covariance_alone, unit.covariance[:12, :12], eigvals_only=True)[-1] > 1.5**2
        assert np.abs((unit.alone.vector - unit.model.vector) / unit.sigma_alone).max() < 5
    assert fit.covariance.shape == (72, 72)
    assert np.linalg.eigvalsh(fit.covariance)[0] > -1e-12


def test_the_command_prints_saves_and_keeps_to_the_page(made, tmp_path, capsys):
    _, folder, fit = made()
    out, table = tmp_path / "out", tmp_path / "x.json"
    assert calibrate.main(["fit", str(folder), "--out", str(out), "--json", str(table), "--bias", "ends"]) == 0
    said = capsys.readouterr().out
    assert "clock" in said
    assert "mounting" in said
    assert "unit minus mean" in said
    times, equal = map(
        float,
        re.search(
            r"rms [\d.]+: ([\d.]+) times less than rms; 3 equal ones would have ([\d.]+) times less", " ".join(said.split())
        ).groups(),
    )
    assert equal == pytest.approx(np.sqrt(3), abs=0.01)
    assert times == pytest.approx(equal, rel=0.1)  # three of one kind
    assert f"next:\n  python calibrate.py explain {shell_word(folder)}" in said
    written = json.loads(table.read_text(encoding="utf-8"))
    assert written == json.loads((out / "array.json").read_text(encoding="utf-8"))
    assert written["schema"] == "tinygc-array-fit/2"
    assert not strangers(written)
    assert written == json.loads(json.dumps(array_to_json(fit)))
    fused = load_array_model(out / "model_array.json")
    assert fused.numbers == (0, 1, 2)
    assert np.allclose(fused.joint_covariance[:12, :12], fit.units[0].covariance[:12, :12])
    for unit in written["units"]:
        model = json.loads((out / unit["model"]).read_text(encoding="utf-8"))
        assert model["kind"] == "linear"
        assert not strangers(model)


@pytest.mark.parametrize("words", [("--physics", "auto"), ("--folds", "3"), ("--bias", "start"), ("--exclude", "1")])
def test_what_makes_no_sense_of_an_array_is_refused_in_a_line(made, words, capsys):
    _, folder, _ = made()
    assert calibrate.main(["fit", str(folder), *words, "--quiet"]) == 2
    said = capsys.readouterr().err.strip()
    assert "array" in said
    assert words[0] in said
    assert "\n" not in said


def test_units_that_stand_out_together_are_not_blamed(made):
    """A blow is felt by all and sampled by each otherwise: of more than one unit at once none is said to read falsely."""
    _, _, fit = made()
    one, other = (ArrayEvent("turn", unit, 3, 4, size * DEG, 1e-9, np.zeros(0, dtype=int)) for unit, size in ((2, 0.5), (0, 2.0)))

    def with_events(*events):
        return dataclasses.replace(fit, joint=dataclasses.replace(fit.joint, events=events))

    (alone,), (both,) = event_lines(with_events(one)), event_lines(with_events(one, other))
    assert "unit 2 misses this turn by 0.5° against the others (F test, p = 1e-09): its own readings" in alone
    assert "2 of 3 units stand out in this turn, each in its own way (unit 0 by 2°, unit 2 by 0.5°)" in both
    assert "its own readings" not in both
    bounded = SimpleNamespace(statement=SimpleNamespace(standing=Standing.BOUNDED))
    parts = SimpleNamespace(common=bounded, all_own=bounded)
    verdicts = [ArrayExplanation(with_events(*events), {}, {}, parts, (), None, {}, ()).verdict for events in ((one,), (one, other))]
    assert verdicts == ["own", "common"]
