"""The twin of a recording beside a truth file: its columns against its own residuals, its noise, and who is named for the truth's clock."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from test_explain_truth import write

from tinygc import read_session
from tinygc.closure.build import build_problem
from tinygc.effects import AppliedEffect
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.truth_names import OFFSET, TruthTwin
from tinygc.noise.components import TRUTH, WANDER
from tinygc.noise.twin import State


def twin_of(folder, sigma_deg=0.02, **wrong) -> TruthTwin:
    write(folder, **wrong)
    toml = folder / "session.toml"
    toml.write_text(toml.read_text().replace("truth_sigma_deg = 0.02", f"truth_sigma_deg = {sigma_deg}"))
    return TruthTwin(build_problem(read_session(folder)))


def late(state: State, seconds: float) -> State:
    return replace(state, claims=(AppliedEffect(OFFSET, np.array([seconds])),))


def test_no_still_is_a_row_and_the_clock_has_a_column(tmp_path):
    twin = twin_of(tmp_path)
    state = late(twin.start(), 0.002)
    rates = twin.rates(state)
    assert twin.residuals(state).stacked().shape == (3 * len(twin.segments),)
    column = twin.effect_columns(OFFSET, state, twin.sensitivity(state, rates), rates).closure[..., 0]
    apart = (twin.residuals(late(state, 0.0021)).closure - twin.residuals(late(state, 0.0019)).closure) / 2e-4
    assert np.abs(column - apart).max() < 0.03 * np.abs(apart).max()


def test_an_exact_shift_undoes_a_late_truth(tmp_path):
    """The rate half way through 8 ms of a turn's bell of 2 s is its mean to a part in ten thousand: nothing is left but the noise."""
    twin = twin_of(tmp_path, late_s=0.008)
    sound = twin_of(tmp_path / "sound")
    state = replace(twin.start(), model=sound.problem.first)
    shifted = min((twin.residuals(late(state, s)).closure for s in (-0.008, 0.008)), key=np.linalg.norm)
    as_it_is, none = twin.residuals(state).closure, sound.residuals(sound.start()).closure
    assert np.linalg.norm(as_it_is) > 4 * np.linalg.norm(none)
    assert np.linalg.norm(shifted) < 1.1 * np.linalg.norm(none)


@pytest.mark.parametrize("stated_deg", [0.005, 0.1])
def test_the_truths_noise_is_what_it_is_and_not_what_is_stated(tmp_path, stated_deg):
    noise = Evidence(twin_of(tmp_path, sigma_deg=stated_deg)).nothing.noise
    # 30 segments' three angles know a sigma to 8 %; three of that.
    assert noise.size(TRUTH) / DEG == pytest.approx(0.02, rel=0.25)
    assert noise.size(WANDER) / DEG < 0.02
