"""The bias instability that uncertainties reckon with: given, typical of a model, or estimated from the stills; injected and recovered."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, session_of

from session.io.config import Site
from session.io.units import DEG, DEG_PER_HOUR
from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.floor import ESTIMATED, GIVEN, UNKNOWN, BiasInstability, estimated
from tinygc.noise.components import known_whitener
from tinygc.noise.twin import Twin
from tinygc.simulation.write import write_session


def of_another(session, **known):
    """The same recording of a sensor that nobody knows."""
    return replace(session, config=replace(session.config, sensor=replace(session.config.sensor, model="another", **known)))


def test_given_comes_before_typical_and_typical_before_the_recording(simulated):
    session = read_session(simulated())
    typical, given, own = (
        build_problem(s).instability for s in (session, of_another(session, gyro_bias_instability_dph=7.5), of_another(session))
    )
    assert (typical.rps, typical.source, typical.sigma_rps) == (3 * DEG_PER_HOUR, "typical of ASM330LHH", None)
    assert (given.rps, given.source, given.of_unit) == (7.5 * DEG_PER_HOUR, GIVEN, False)
    assert (own.source, own.of_unit) == (ESTIMATED, True)
    assert own.sigma_rps > 0
    assert typical.words == "3 °/h, typical of ASM330LHH"
    assert given.words == "7.5 °/h, given"
    assert given.to_json()["gyro_bias_instability_dph"] == pytest.approx(7.5)
    assert given.to_json()["gyro_bias_instability_sigma_dph"] is None


def test_it_says_what_it_knows():
    assert BiasInstability(6.2 * DEG_PER_HOUR, ESTIMATED, 1.9 * DEG_PER_HOUR, 9 * DEG_PER_HOUR).words == f"6.2 ± 1.9 °/h, {ESTIMATED}"
    unseen = BiasInstability(2 * DEG_PER_HOUR, ESTIMATED, 1.5 * DEG_PER_HOUR, 5 * DEG_PER_HOUR).words
    assert unseen.endswith("which does not show it: less than 5 °/h (95 %)")
    assert BiasInstability(26.7 * DEG_PER_HOUR, ESTIMATED, 12 * DEG_PER_HOUR, 9).words.startswith("27 ± 12 °/h")


def test_nothing_at_rest_is_no_estimate(simulated):
    problem = build_problem(of_another(read_session(simulated())))
    none = estimated([replace(log, stills=[], q_tb=log.q_tb[:0], group=log.group[:0]) for log in problem.logs], problem.earths)
    assert (none.rps, none.source) == (0.0, UNKNOWN)
    assert none.to_json()["gyro_bias_instability_dph"] is None
    few = [replace(log, stills=log.stills[:2], q_tb=log.q_tb[:2], group=log.group[:2]) for log in problem.logs]
    assert estimated(few, problem.earths).source == UNKNOWN


#: an ASM330LHH's registers, of a sensor that is not named
UNNAMED = '"unnamed"\ngyro_mdps_per_lsb = 17.5\naccel_mg_per_lsb = 0.122\ntemp_lsb_per_c = 256\ntemp_at_zero_c = 25'


def test_the_sigmas_follow_it_and_the_closure_does_not(simulated, run, tmp_path):
    """Through the command line: a sensor of another name, and one with ten times the instability given."""
    tables = {}
    for name, line in (("typical", ""), ("given", "gyro_bias_instability_dph = 30\n"), ("other", "")):
        folder = tmp_path / name
        shutil.copytree(simulated(), folder)
        text = (folder / "session.toml").read_text().replace("[accelerometer]", line + "[accelerometer]")
        (folder / "session.toml").write_text(text.replace('"ASM330LHH"', UNNAMED) if name == "other" else text)
        code, out, _ = run("fit", folder, "--methods", "least_squares", "--verbose", "--json", tmp_path / f"{name}.json")
        assert code == 0
        words = {"typical": "3 °/h, typical of ASM330LHH", "given": "30 °/h, given", "other": ESTIMATED}[name]
        assert words in " ".join(out.split())
        tables[name] = json.loads((tmp_path / f"{name}.json").read_text())
        tables[name]["covariance"] = json.loads((folder / "fit" / "model_least_squares.json").read_text())["covariance"]
    assert tables["typical"]["methods"]["least_squares"]["holdout"] == tables["given"]["methods"]["least_squares"]["holdout"]
    assert tables["typical"]["methods"]["least_squares"]["holdout"] == tables["other"]["methods"]["least_squares"]["holdout"]
    sigma = {name: np.sqrt(np.diag(table["covariance"]))[9:] for name, table in tables.items()}
    assert np.all(sigma["given"] > 3 * sigma["typical"])
    noise = tables["other"]["noise"]
    assert noise["gyro_bias_instability_source"] == ESTIMATED
    assert noise["gyro_bias_instability_sigma_dph"] > 0
    assert tables["typical"]["noise"]["gyro_bias_instability_dph"] == 3.0


def test_what_was_estimated_of_the_unit_is_not_widened_as_a_data_sheet_s_is(simulated):
    session = read_session(simulated())
    own = build_problem(of_another(session))
    same = build_problem(of_another(session, gyro_bias_instability_dph=own.instability.rps / DEG_PER_HOUR))
    narrow, wide = (known_whitener(Twin(problem)).sigma for problem in (own, same))
    assert np.all(narrow <= wide * (1 + 1e-12))
    assert np.any(narrow < 0.99 * wide)


def test_a_step_a_drift_and_gravity_are_not_taken_for_wander():
    """On a sensor without wander: 0.3 dps over the log, a step of 0.1 dps in the middle, and 0.2 dps/g."""
    samples = Table().tumble(30, rest_s=3.0, seed=4).samples(seed=4)
    part = (samples.t_s / samples.t_s[-1])[:, None]
    wrong = samples.gyro + (0.3 * part + 0.1 * (part > 0.5) + 0.2 * samples.accel[:, [1, 2, 0]] / 9.80665) * DEG
    for gyro in (samples.gyro, wrong):
        session = session_of(replace(samples, gyro=gyro), model="another")
        # This table stands on no turning Earth.
        known = build_problem(replace(session, config=replace(session.config, site=Site()))).instability
        assert known.most_rps < 8 * DEG_PER_HOUR  # the step alone is 360 degrees an hour
        assert known.rps < 2 * known.sigma_rps


def estimates(instability_dph: float, seeds: range, tmp_path) -> np.ndarray:
    """(seeds, 3) °/h: estimate, sigma, 95 % limit, of sessions of 20 turns and of a sensor that nobody knows."""
    found = []
    for seed in seeds:
        options = SimulationOptions(segments=20, closure_s=0.0, seed=seed, odr_hz=104.0, bias_instability_dph=instability_dph)
        session = of_another(read_session(write_session(options, tmp_path / f"{instability_dph:g}_{seed}")))
        own = build_problem(session).instability
        found.append(np.array([own.rps, own.sigma_rps, own.most_rps]) / DEG_PER_HOUR)
    return np.array(found)


@pytest.mark.slow
def test_three_degrees_and_thirty_are_told_apart(tmp_path):
    little, much = (estimates(true, range(3), tmp_path) for true in (3.0, 30.0))
    assert np.all(np.abs(little[:, 0] - 3) < 3 * little[:, 1])
    assert np.all(np.abs(much[:, 0] - 30) < 3 * much[:, 1])
    assert little[:, 0].max() < much[:, 0].min()


@pytest.mark.slow
@pytest.mark.parametrize(("true", "least"), [pytest.param(3.0, 0.4, marks=pytest.mark.slow), (10.0, 0.8)])
def test_inject_and_recover(true, least, tmp_path):
    """24 sessions: unbiased within half a stated sigma, and the stated sigma is the scatter's.  3 degrees an hour are hardly seen in 21
    stills: what cannot be negative scatters less than it may be wrong by."""
    found = estimates(true, range(100, 124), tmp_path)
    z = (found[:, 0] - true) / found[:, 1]
    assert abs(z.mean()) < 0.5
    assert least < np.sqrt(np.mean(z**2)) < 1.4
    assert np.mean(found[:, 2] > true) > 0.85


@pytest.mark.slow
def test_no_wander_is_not_seen(tmp_path):
    """An estimate that cannot be negative stands above zero by its sigma; hardly any says that it sees something."""
    found = estimates(0.0, range(100, 124), tmp_path)
    assert np.mean(found[:, 0] / found[:, 1]) < 2
    assert np.mean(found[:, 0] > 2 * found[:, 1]) < 0.2
    assert np.median(found[:, 2]) < 8
