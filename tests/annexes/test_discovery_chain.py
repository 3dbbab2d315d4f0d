"""From a session that hides a law to the file of it, and on to every command, in a second session that turns otherwise."""

import gzip
import json

import numpy as np
import pytest
from discovery_answers import LAWS, hidden

import calibrate
from session.io.units import DEG
from tinygc.annexes.discovery import engine
from tinygc.annexes.discovery.form import Factor, LawForm

#: the law, what is near it, and some that have nothing to do with it
FORMS = [
    LAWS["cross"][0],
    *(LawForm((Factor("rate", name),)) for name in ("square", "cube", "root_cube")),
    *(LawForm((Factor(name, "square"),)) for name in ("acceleration", "force", "time")),
    LawForm((Factor("force"), Factor("rate"))),
    LawForm((Factor("rate"), Factor("rate")), "next"),
]
ID = "discovered.force_rate_next"


@pytest.fixture(scope="module")
def sessions(tmp_path_factory):
    """Two that hide force times rate of the neighbours; another unit, turned more briskly."""
    folder = tmp_path_factory.mktemp("chain")
    first = hidden("cross", folder / "first", segments=20, warm_up_c=0.0)
    return first, hidden("cross", folder / "second", segments=12, warm_up_c=0.0, seed=6, vigour=1.4)


def test_a_law_that_is_found_is_named_and_calibrated_away_elsewhere(sessions, tmp_path, monkeypatch):
    first, second = sessions
    monkeypatch.setattr(engine, "enumerated", lambda largest: FORMS)

    def done(*words) -> None:
        assert calibrate.main([str(word) for word in (*words, "--quiet")]) == 0

    done("explain", first, "--discover", "--no-pictures")
    (law,) = _json(first / "explain" / "explain.json")["discovery"]["laws"]
    assert law["id"] == ID
    assert law["parameters"]["dps_per_g"] == pytest.approx(LAWS["cross"][1], abs=0.1)

    use = ("--effects", first / "explain" / "effects")
    done("fit", second, "--physics", "auto", "--methods", "least_squares", *use)
    (named,) = _json(second / "fit" / "model_physics.json")["effects"]
    assert named["id"] == ID
    assert np.array(named["theta_si"]) / DEG == pytest.approx(LAWS["cross"][1], abs=0.1)
    closure = {name: each["holdout"]["tilt_rms_deg"] for name, each in _json(second / "fit" / "fit.json")["methods"].items()}
    assert closure["physics"] < 0.3 * closure["least_squares"]

    (log,) = second.glob("log*")
    done("apply", second / "fit" / "model_physics.json", log, "-o", tmp_path / "calibrated.csv", *use)
    with gzip.open(log, "rt", encoding="utf-8") as raw, (tmp_path / "calibrated.csv").open(encoding="utf-8") as calibrated:
        samples, rates = (sum(line[0].isdigit() for line in lines) for lines in (raw, calibrated))
    assert rates == samples > 1000
    done("export", second, "--to", "json", "--model", "physics", *use)

    parameters = {"dps_per_g": LAWS["cross"][1]}
    made = tmp_path / "made"
    done("simulate", "--out", made, "--segments", 4, "--closure", 0, "--effect", f"{ID}={json.dumps(parameters)}", *use)
    assert _json(made / "truth.json")["effects"][ID] == parameters


def _json(path):
    return json.loads(path.read_text(encoding="utf-8"))
