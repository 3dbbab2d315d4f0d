"""The certificate: what is on it, what leaves a draft, the report's numbers with one U."""

from __future__ import annotations

import gzip
import json
import re
import shutil
from dataclasses import replace
from datetime import date
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from browser import browser_path

import tinygc
from session.base.errors import CalibrationError, FormatError
from session.base.toml import parse_toml
from session.base.units import DEG
from session.log.config import config_of
from tinygc.estimation.spread import ZERO, Spread
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.certificate.content import Certificate, page
from tinygc.features.unit.certificate.given import REQUIRED
from tinygc.inference.solve import coverage_factor, effective_freedom
from tinygc.library.reports import Report
from tinygc.models.linear import LinearModel, field_jacobian
from tinygc.verdict.acceptance import decide

#: sessions' folders without truth.json, which leaves a draft; the logs have paths of their own
RECORDED = TemporaryDirectory(prefix="tinygc-")
FIELDS = """
[board]
source = "sensor"
firmware = "Firmwareword"
registers = "5C5844E2"

[notes]
operator = "Noteoperator"
date = 2026-11-20

[certificate]
laboratory = "Laboratoryword"
address = "Labaddressword"
customer = "Customerword"
customer_address = "Customeraddressword"
number = "Numberword-7"
amends = "Amendsword"
item = "Itemword"
manufacturer = "Manufacturerword"
condition = "Conditionword"
place = "Placeword"
operator = "Operatorword"
authorised_by = "Authorword"
role = "Roleword"
received = 2026-11-16
calibrated = 2026-11-20
issued = 2026-11-23
valid_until = 2027-11-19
next_calibration = 2027-11-20
method = "Methodword"
deviations = "Deviationword"
conditions = "Environmentword"
external = "Externalword"
remarks = "Remarkword"

[certificate.traceability]
gravity = "Gravityword"
clock = "Clockword"
angle = "Angleword"

[[certificate.equipment]]
name = "Equipmentword"
identification = "Identificationword"
certificate = "Equipmentcertificateword"
due = 2027-05-31

[requirements]
rule = "guard band"
reference = "Specificationword"
[requirements.closure_deg]
upper = 5
[requirements.gyro_bias_mdps]
lower = -5000
upper = 5000
[requirements.accel_bias_mg]
upper = 100
"""


def with_fields(data: ReportData, fields: str = FIELDS, serial: str = "Serialword") -> ReportData:
    """The data of a report whose session.toml has these sections as well; nothing is fitted again."""
    session = data.fit.session
    folder = Path(RECORDED.name) / session.folder.name
    path = folder / "session.toml"
    if not path.exists():
        folder.mkdir()
        text = (session.folder / "session.toml").read_text(encoding="utf-8")
        path.write_text(text.replace("SIMULATED", "recorded"), encoding="utf-8")
    plain = path.read_text(encoding="utf-8")
    table = parse_toml(f"{plain}\n{fields}", str(path))
    table["sensor"] |= {"serial": serial, "clock_sigma_ppm": 20.0}
    config = replace(config_of(Path("session.toml"), table), accelerometer=session.config.accelerometer)
    problem = data.fit.problem.changed(session=replace(session, config=config, folder=folder))
    found = replace(data, fit=replace(data.fit, problem=problem))
    return replace(found, decision=limited(found))


METHODS = ("raw", "least_squares")


@pytest.fixture(scope="module")
def data(simulated):
    return tinygc.report(simulated(segments=16), explain=False, methods=METHODS).data


@pytest.fixture(scope="module")
def made(data):
    return with_fields(data)


@pytest.fixture(scope="module")
def filled(made):
    new = LinearModel.from_vector(made.adopted.vector)
    return Certificate(made, LinearModel(1.001 * new.E, new.B), "old.json")


def words_of(content) -> str:
    body = re.sub(r"<style>.*?</style>", " ", page(content), flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


def values_of(rows) -> dict:
    return {each.name: each for each in rows}


def changed(data, **parts):
    """Data whose session's config has other parts: ``sensor={"model": "X"}``."""
    session = data.fit.session
    changes = {name: replace(getattr(session.config, name), **value) if isinstance(value, dict) else value for name, value in parts.items()}
    problem = data.fit.problem.changed(session=replace(session, config=replace(session.config, **changes)))
    return replace(data, fit=replace(data.fit, problem=problem))


def limited(data):
    fit = data.fit
    return decide(data.adopted, [run.file for run in fit.runs], None, fit.against_raw, fit.accelerometer, [], fit.requirements)


# What is on it


def test_every_field_of_the_session_is_on_the_page_and_nothing_else(filled, data):
    words = words_of(filled)
    fields = re.findall(r'^\w+ = (?:"(.*?)"|(\d{4}-\d\d-\d\d))$', FIELDS, flags=re.MULTILINE)
    never = {"sensor", "guard band", "Noteoperator"}  # replaced by a field of the certificate
    for value in {a or b for a, b in fields} - never:
        assert value in words, value
    assert filled.draft == filled.missing == ()
    assert "End of certificate Numberword-7" in words
    assert not re.search("DRAFT|not stated", words)
    first, other = (words_of(Certificate(with_fields(data, text))) for text in (FIELDS, FIELDS.replace("word", "other")))
    assert first.replace("word", "other").lower() == other.replace("word", "other").lower()


def test_the_results_are_those_of_the_report_with_their_k(data, filled):
    rows, size = values_of(filled.results), {"dps": 1e3}
    slopes = field_jacobian(data.adopted.vector)
    for slope, q in zip(slopes, data.adopted.quantities, strict=True):
        variances, freedoms = zip(*((float(each.variance(slope[None])[0]), each.freedom) for each in data.fit.sources), strict=True)
        moved = float(data.fit.allowed.of(slope[None])[0])
        assert q.factor == pytest.approx(coverage_factor(effective_freedom([*variances, moved**2], [*freedoms, np.inf])))
        assert q.u == pytest.approx(q.moved / moved * np.sqrt(sum(variances) + moved**2))
        row = rows[f"gyroscope {q.name}"]
        assert (row.value, row.expanded) == pytest.approx((q.value * size.get(q.unit, 1), q.expanded * size.get(q.unit, 1)))
    closure, floor = filled.closure[0]
    assert closure.value == pytest.approx(np.sqrt(np.mean(np.sum(data.adopted.angles[:, :2] ** 2, axis=1))) / DEG)
    assert floor == pytest.approx(data.adopted.floor_rms / DEG)


def test_the_bias_at_any_switch_on_has_its_spread_and_a_widened_sigma_its_factor(data):
    spread = Spread.of(ZERO, 0.1 * DEG, "three sessions")
    rows = values_of(Certificate(replace(data, fit=replace(data.fit, spread=spread))).results)
    usual, any_time = rows["gyroscope bias x"], rows["gyroscope bias at any switch-on x"]
    assert any_time.value == usual.value
    assert any_time.sigma == pytest.approx(np.hypot(usual.sigma, np.sqrt(2) * 100), rel=0.02)  # b = -E^-1 B, E near the identity
    widened = Certificate(replace(data, fit=replace(data.fit, widened=2.25)))
    assert "standard uncertainties are multiplied by 1.50" in " ".join(widened.uncertainty)


def test_as_found_are_the_errors_that_the_old_calibration_leaves(data):
    new = LinearModel.from_vector(data.adopted.vector)
    gain, zero = np.diag([1.001, 1.0, 1.0]), np.array([0.0, 0.002, 0.0])
    old = LinearModel(gain @ new.E, gain @ new.B + zero)  # which makes of each rate w: gain w + zero
    rows = values_of(Certificate(data, old, "old.json").as_found)
    assert rows["gyroscope scale factor error x"].value == pytest.approx(1000, abs=1e-6)
    assert rows["gyroscope scale factor error y"].value == pytest.approx(0, abs=1e-6)
    assert rows["gyroscope bias y"].value == pytest.approx(2 / DEG, rel=1e-9)
    assert max(abs(each.value) for each in values_of(Certificate(data, new, "same.json").as_found).values()) < 1e-6


def test_fit_report_and_certificate_have_one_u_and_one_decision(data):
    """Limits within U with the effect that the model lacks, and beyond U without it: no page may decide."""
    q = next(q for q in data.adopted.quantities if (q.word, q.component) == ("scale factor error", "x"))
    alone, key = 2 * q.sigma, "gyro_scale_factor_error_x_ppm"
    near = q.value + (alone + q.expanded) / 2
    near_it = with_fields(data, FIELDS + f"[requirements.{key}]\nlower = {q.value - 1e5}\nupper = {near}\n")
    (one,) = (each for each in limited(replace(near_it, adopted=near_it.fit.candidate)).conformities if each.measured.key == key)
    (other,) = (each for *_, of in Certificate(near_it).statements for each in of if each.measured.key == key)
    assert one.to_json() == other.to_json()
    assert (one.measured.expanded, one.answer) == (pytest.approx(q.expanded), "not decided")


def test_the_clock_states_how_it_is_known(data):
    for clock, stated, there in (
        ("board", {"clock_sigma_ppm": 20.0}, r"whose clock is known to 20 ppm \(k = 1\), which is in U"),
        ("board", {"clock_sigma_ppm": 12.0, "clock_ratio": 1.0045}, "4500 ± 12 ppm fast .* a deviation that is not corrected"),
        ("arrivals", {"clock_sigma_ppm": 12.0}, "^time by the computer's second.* known to 12 ppm .k = 1., which is in U"),
    ):
        other = changed(data, sensor=stated)
        found = Certificate(replace(other, fit=replace(other.fit, options=replace(data.fit.options, clock=clock))))
        assert re.search(there, next(text for label, text, _ in found.traceability if label == "Clock"))


# A draft


def test_each_field_that_is_missing_leaves_a_draft_and_is_named(data):
    content = Certificate(with_fields(data, FIELDS.replace('customer = "Customerword"\n', "")))
    assert content.missing == ("certificate.customer",)
    for says in ("DRAFT: this is no calibration certificate", "certificate.customer"):
        assert says in words_of(content)
    bare = Certificate(data)
    keys = {f"certificate.{key}" for key in REQUIRED} | {f"certificate.traceability.{key}" for key in ("gravity", "clock", "angle")}
    assert keys | {"certificate.calibrated"} <= set(bare.missing)  # the log's file alone tells the day
    assert bare.line.startswith("certificate: a draft; not stated: certificate.laboratory")
    assert bare.to_json() == {"number": None, "draft": list(bare.draft), "missing": list(bare.missing)}
    assert "the recording is simulated: truth.json is in its folder" in bare.draft


ISSUED = "calibrated = 2026-11-20\nissued = 2026-11-23"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("due = 2027-05-31", "due = 2026-11-19"), "equipment was overdue on the day of the calibration: Equipmentword"),
        ((ISSUED, "issued = 2026-11-19"), "issued is 2026-11-19, before calibrated, 2026-11-20"),
        ((f"received = 2026-11-16\n{ISSUED[:23]}", "received = 2026-11-21"), "calibrated is 2026-11-20, before received, 2026-11-21"),
        (('source = "sensor"', 'source = "stand-in"'), ".*no sensor"),
    ],
)
def test_fields_that_do_not_go_together_leave_a_draft(data, change, says):
    text = FIELDS.replace(*change)
    assert text != FIELDS
    (why,) = Certificate(with_fields(data, text)).draft
    assert re.match(says, why)


def test_what_the_recording_lacks_leaves_a_draft(made, data, tmp_path):
    assert Certificate(with_fields(data, serial="")).missing == ("sensor.serial",)
    assert Certificate(changed(made, model_given=False)).missing == ("sensor.model",)
    with pytest.raises(CalibrationError, match=r"no certificate: time base not calibrated; give sensor\.clock_sigma_ppm"):
        tinygc.certificate(Report(changed(made, sensor={"clock_sigma_ppm": None})))
    why = "closure of the fitted segments: p = 0.001, more than noise allows"
    failed = Certificate(replace(made, decision=replace(data.decision, unsound=[why])))
    assert failed.draft == (f"the calibration does not pass its own check: {why}",)
    for name, packed in (("log.csv", bytes), ("log.csv.gz", gzip.compress)):
        (tmp_path / name).write_bytes(packed(b"# SIMULATED by another program\nt_us,gx_dps\n"))
        session = made.fit.session
        logs = (replace(session.logs[0], path=tmp_path / name), *session.logs[1:])
        other = made.fit.problem.changed(session=replace(session, logs=logs))
        found = Certificate(replace(made, fit=replace(made.fit, problem=other)))
        assert found.draft == (f"the recording is simulated: by the first line of {name}",)


DAYS = [day for day in re.findall(r"^(\w+) = \d{4}-", FIELDS, re.M) if day not in ("date", "due")]


@pytest.mark.parametrize("second", range(1, len(DAYS)))
def test_days_out_of_order_and_texts_that_no_page_has_room_for_are_refused(data, second):
    """next_calibration may be before valid_until."""
    for first in range(min(second, 3)):
        text = re.sub(rf"(?m)^{DAYS[first]} = .*", f"{DAYS[first]} = {date(2029, 11, 21)}", FIELDS)
        with pytest.raises(FormatError, match=rf"certificate\.{DAYS[first + 1]} is .*, expected no day before {DAYS[first]}, 2029-11-21"):
            with_fields(data, text)
    for text in ("x" * 301, r"a\nb", " "):
        with pytest.raises(FormatError, match=r"certificate.customer is .*, expected text on one line, of at most 300 characters"):
            with_fields(data, FIELDS.replace("Customerword", text))


# Files and commands


def test_the_command_writes_report_and_certificate(simulated, tmp_path, run):
    folder, table = tmp_path / "session", tmp_path / "r.json"
    shutil.copytree(simulated(segments=16), folder, ignore=shutil.ignore_patterns("truth.json"))
    toml = folder / "session.toml"
    marked, recorded = toml.read_text(encoding="utf-8").split("\n", 1)
    assert marked.startswith("# SIMULATED")
    toml.write_text(recorded.replace("[sensor]\n", "[sensor]\nclock_sigma_ppm = 20\n") + FIELDS, encoding="utf-8")
    words = ("--methods", "raw,least_squares", "--no-explain", "--out", tmp_path / "r.html")
    code, said, _ = run("report", folder, "--certificate", "--json", table, *words)
    (tmp_path / "r.html").unlink()
    assert code == 0
    assert "certificate.html" in said
    assert json.loads(table.read_text())["certificate"]["number"] == "Numberword-7"
    assert "End of certificate" in (folder / "certificate.html").read_text(encoding="utf-8")
    for more, says in (
        (("--as-found", toml), "--as-found is stated on a certificate: add --certificate"),
        ((folder, "--certificate", "--as-found", toml), "--as-found names one file"),
        (("--certificate", folder / "certificate.html"), "holds a certificate, which may be issued; move it"),
    ):
        code, _, err = run("report", folder, *more, *words)
        assert (code, says in err) == (2, True), err
    assert not (tmp_path / "r.html").exists()


@pytest.mark.browser
def test_it_prints_on_two_sheets(made, tmp_path):
    if browser_path() is None:
        pytest.skip("needs Chromium")
    _, pdf = Certificate(made).save(tmp_path / "certificate.html", pdf=True)
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", pdf.read_bytes())) == 2
