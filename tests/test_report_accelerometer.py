"""The report's accelerometer: a card, a section, and a decision that knows what nobody has observed."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from html_pages import parsed

import tinygc
from session.base.units import MG
from tinygc.inference.solve import coverage_factor, effective_freedom
from tinygc.reporting.html.page import page
from tinygc.reporting.html.sections import accelerometer, answer, closure_per_segment
from tinygc.verdict.acceptance import decide

LEFT = ("nonorthogonality xy", "nonorthogonality yz")


@pytest.fixture(scope="module")
def evidence(simulated, tmp_path_factory):
    """Of a session without [accelerometer]."""
    folder = shutil.copytree(simulated(), tmp_path_factory.mktemp("bare") / "bare")
    text = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(re.sub(r"(?s)\[accelerometer\].*?(?=\n\[|$)", "", text))
    return tinygc.report(folder, explain=False, methods=("raw", "least_squares"), folds=2).data


def words_of(html):
    return re.sub(r"\s+", " ", re.sub("<[^>]*>", " ", html))


def test_the_section_has_the_nine_numbers_each_with_its_sigma(evidence):
    found, sources = evidence.fit.accelerometer, evidence.fit.joint_sources
    text = words_of(accelerometer.section(evidence).html)
    assert "own stills and turns" in text
    numbers = found.facts
    assert [q.component for q in numbers] == ["x", "y", "z", "xy", "xz", "yz", "x", "y", "z"]
    np.testing.assert_allclose([q.value for q in numbers[6:]], found.calibration.bias_mps2 / MG)
    whole = evidence.fit.joint_covariance
    np.testing.assert_allclose(sum(each.covariance for each in sources), whole, rtol=1e-9, atol=1e-12 * np.abs(whole).max())
    for q, turned in zip(numbers[6:], found.jacobian[6:], strict=True):  # a bias is an error as it is a parameter
        variances = [float(turned @ source.covariance[:9, :9] @ turned) for source in sources]
        freedom = effective_freedom(variances, [source.freedom for source in sources])
        assert np.isfinite(freedom)
        assert q.expanded == pytest.approx(coverage_factor(freedom) * np.sqrt(sum(variances)) / MG)
    assert len(re.findall("± ", text)) == 10  # nine, and the caption's
    before, after = found.misses_mps2
    assert np.std(before) > 100 * np.std(after)
    assert f"{np.std(before) / MG:.0f} mg" in text
    log = evidence.fit.session.logs[0].samples  # before: as measured, not what the lengths' own first estimate makes of it
    measured = [np.linalg.norm(log.accel[s.start : s.stop].mean(axis=0)) for s in evidence.problem.stills if s.problem is None]
    np.testing.assert_allclose(before, np.subtract(measured, evidence.fit.session.config.site.expected_gravity_mps2), atol=2e-3 * MG)


def test_what_is_not_observed_is_said_on_card_table_and_decision(evidence):
    problem = replace(evidence.problem, joint=replace(evidence.problem.joint, unobserved=LEFT))
    fit = replace(evidence.fit, problem=problem)
    decision = decide(evidence.adopted, [run.file for run in fit.runs], None, accelerometer=fit.accelerometer)
    made = replace(evidence, fit=fit, decision=decision)
    text = page(made)
    parsed(text)
    assert "2 of its 9 numbers not observed" in words_of(text)
    assert f"Not observed here: {', '.join(LEFT)}" in words_of(text)
    assert words_of(accelerometer.section(made).html).count("not observed") == 2
    assert decision.answer in ("not decided", "fail")
    assert any("nonorthogonality xy" in doubt for doubt in decision.doubts)


@pytest.mark.parametrize(
    ("times", "cost", "why"),
    [(0.999, "no more", "no more than noise alone is expected to leave"), (1.001, "a little more", "by a fit with fewer turns")],
)
def test_a_closure_below_and_one_above_its_floor_are_each_described_as_they_are(evidence, times, cost, why):
    adopted = replace(evidence.adopted, angles=evidence.adopted.angles * times / evidence.adopted.times_floor)
    made = replace(evidence, adopted=adopted)
    assert f"held out they cost {cost}, with" in words_of(answer.section(made).html)
    assert why in words_of(closure_per_segment.section(made).html)


def test_the_answer_states_whose_limit_it_is_and_breaks_no_option(evidence):
    decision = replace(evidence.decision, rule="PASS needs --limit DEG.", limit_deg=0.0475, limit_from="twice a sheet")
    text = answer.section(replace(evidence, decision=decision)).html
    assert '<p>PASS needs <span style="white-space:nowrap">--limit</span> DEG. Limit 0.048°: twice a sheet.</p>' in text
