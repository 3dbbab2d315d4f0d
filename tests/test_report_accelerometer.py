"""The report's accelerometer: a card, a section, and a decision that knows what nobody has observed."""

import re
from dataclasses import replace

import numpy as np
import pytest
from html_pages import parsed

from session.io.units import MG
from tinygc import FitOptions
from tinygc.estimation.requirements import accelerometer_measured
from tinygc.estimation.sources import coverage_factor, effective_freedom, total
from tinygc.estimation.verdict import decide
from tinygc.reporting.html.evidence import gather
from tinygc.reporting.html.page import page
from tinygc.reporting.html.sections import accelerometer

LEFT = ("nonorthogonality xy", "nonorthogonality yz")


def bare_copy(folder, out):
    """Without [accelerometer]."""
    import shutil

    shutil.copytree(folder, out, ignore=shutil.ignore_patterns("fit", "explain", "report*"))
    text = (out / "session.toml").read_text()
    head, rest = text.split("[accelerometer]")
    (out / "session.toml").write_text(head + "[" + rest.split("\n[", 1)[1] if "\n[" in rest else head)
    return out


@pytest.fixture(scope="module")
def bare(simulated, tmp_path_factory):
    return bare_copy(simulated(), tmp_path_factory.mktemp("bare") / "bare")


@pytest.fixture(scope="module")
def evidence(bare):
    return gather(bare, FitOptions(methods=("raw", "least_squares"), folds=2), explain=False)


def words_of(html):
    return re.sub(r"\s+", " ", re.sub("<[^>]*>", " ", html))


def test_the_section_has_the_nine_numbers_with_their_expanded_uncertainties(evidence):
    found = evidence.fit.accelerometer
    text = words_of(accelerometer.section(evidence).html)
    assert "own stills and turns" in text
    numbers = accelerometer.quantities(found)
    assert [q.component for q in numbers] == ["x", "y", "z", "xy", "xz", "yz", "x", "y", "z"]
    np.testing.assert_allclose([q.value for q in numbers[6:]], found.calibration.bias_mps2 / MG)
    whole = evidence.fit.joint_covariance
    np.testing.assert_allclose(total(evidence.fit.joint_sources), whole, rtol=1e-9, atol=1e-12 * np.abs(whole).max())
    for q, turned in zip(numbers[6:], found.jacobian[6:], strict=True):  # a bias is an error as it is a parameter
        variances = [float(turned @ source.covariance[:9, :9] @ turned) for source in evidence.fit.joint_sources]
        freedom = effective_freedom(variances, [source.freedom for source in evidence.fit.joint_sources])
        assert np.isfinite(freedom)
        assert q.expanded == pytest.approx(coverage_factor(freedom) * np.sqrt(sum(variances)) / MG)
    measured = {each.key: each for each in accelerometer_measured(found)}
    assert measured["accel_bias_x_mg"].expanded == pytest.approx(numbers[6].expanded)
    assert len(re.findall("± ", text)) == 10  # nine, and the caption's
    before, after = (float(np.std(each)) / MG for each in found.misses_mps2)
    assert before > 100 * after
    assert f"{before:.0f} mg" in text


def unobserved(evidence):
    problem = replace(evidence.problem, joint=replace(evidence.problem.joint, unobserved=LEFT))
    fit = replace(evidence.fit, problem=problem)
    return replace(
        evidence, fit=fit, decision=decide(evidence.adopted, [run.file for run in fit.runs], None, accelerometer=fit.accelerometer)
    )


def test_what_is_not_observed_is_said_on_card_table_and_decision(evidence):
    made = unobserved(evidence)
    text = page(made)
    parsed(text)
    words = words_of(text)
    assert "2 of its 9 numbers not observed" in words
    assert f"Not observed here: {', '.join(LEFT)}" in words
    assert words_of(accelerometer.section(made).html).count("not observed") == 2
    assert made.decision.answer in ("not decided", "fail")
    assert any("nonorthogonality xy" in doubt for doubt in made.decision.doubts)
