"""The twin of a recording beside a truth file: its columns against its own residuals, its noise, and who is named for the truth's clock."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from scipy.spatial.transform import Rotation, Slerp
from test_explain_truth import write
from truth_sessions import Wrong, made

from tinygc import read_session
from tinygc.closure.build import build_problem
from tinygc.closure.prepared import prepare
from tinygc.effects import AppliedEffect
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.truth_names import OFFSET, SMOOTHING, TruthTwin
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


def smoothed(width_s: float) -> TruthTwin:
    """A truth without noise, each attitude a mean over ``width_s``, by Slerp and Rotation.mean; beside the gyro's true matrix and bias."""
    session, _ = made(Wrong(turns=10, every_s=0.01, sigma_deg=1e-4, misaligned=0.0))
    (truth,) = session.truths
    t_s = truth.t_ns * 1e-9
    at = Slerp(t_s, Rotation.from_quat(truth.q_nb, scalar_first=True))
    inside = (t_s > t_s[0] + 0.1) & (t_s < t_s[-1] - 0.1)
    if width_s:
        seen = at((t_s[inside][:, None] + np.linspace(-width_s / 2, width_s / 2, 101)[:-1] + width_s / 200).ravel())
        q = np.array([seen[100 * i : 100 * i + 100].mean().as_quat(scalar_first=True) for i in range(inside.sum())])
    else:
        q = truth.q_nb[inside]
    session = replace(session, truths=(replace(truth, t_ns=truth.t_ns[inside], q_nb=q),))
    # 1.7 s: at the same phase of every turn of 2 s, smoothing and delay were one.
    session = replace(session, config=replace(session.config, protocol=replace(session.config.protocol, segment_s=1.7)))
    return TruthTwin(prepare(session).problem)


def test_a_smoothed_truth_errs_by_half_its_windows_variance_times_the_change_of_the_rate():
    twin, sound = smoothed(0.12), smoothed(0.0)
    plain = replace(twin.start(), model=sound.problem.first)

    def residuals(variance: float) -> np.ndarray:
        return twin.residuals(replace(plain, claims=(AppliedEffect(SMOOTHING, np.array([variance])),))).closure.ravel()

    state = replace(plain, claims=(AppliedEffect(SMOOTHING, np.array([1e-3])),))
    rates = twin.rates(state)
    column = twin.effect_columns(SMOOTHING, state, twin.sensitivity(state, rates), rates).closure[..., 0].ravel()
    np.testing.assert_allclose(column, (residuals(1.1e-3) - residuals(0.9e-3)) / 2e-4, atol=0.02 * np.abs(column).max())
    variance = -float(column @ residuals(0.0)) / float(column @ column)
    # T^2 / 12; over 120 ms of a bell of 2 s the next term is 1 % of it.
    assert variance == pytest.approx(0.12**2 / 12, rel=0.05)
    assert np.linalg.norm(residuals(variance)) < 0.3 * np.linalg.norm(residuals(0.0))


def test_a_clock_is_not_taken_for_a_smoothing_and_has_its_place_beside_one():
    twin = smoothed(0.12)
    both = replace(twin.start(), claims=(AppliedEffect(OFFSET, np.array([0.002])), AppliedEffect(SMOOTHING, np.array([1e-3]))))
    rates = twin.rates(both)
    sensitivity = twin.sensitivity(both, rates)
    clock, smooth = (twin.effect_columns(effect, both, sensitivity, rates).closure[..., 0].ravel() for effect in (OFFSET, SMOOTHING))
    assert abs(clock @ smooth) < 0.5 * np.linalg.norm(clock) * np.linalg.norm(smooth)
