"""The certificate and its DCC: what is on them, what leaves a draft, the report's numbers with one U, valid by PTB's schema."""

import gzip
import json
import re
import shutil
from dataclasses import replace
from datetime import date
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from browser import browser_path

import tinygc
from session.base.errors import CalibrationError, FormatError
from session.base.toml import parse_toml
from session.base.units import DEG, MG
from session.log.config import config_of
from tinygc.estimation.spread import ZERO, Spread
from tinygc.features.unit.certificate.content import Certificate, page
from tinygc.features.unit.certificate.dcc_file import UNITS, dcc_text
from tinygc.features.unit.certificate.given import REQUIRED
from tinygc.inference.decide import Fact
from tinygc.inference.solve import coverage_factor, effective_freedom
from tinygc.library.reports import Report
from tinygc.models.linear import LinearModel, field_jacobian
from tinygc.verdict.acceptance import decide

#: of one number, and of a list
EXPANDED = ("valueExpandedMU", "valueExpandedMUXMLList")
FACTORS, PROBABILITIES = ("coverageFactor", "coverageFactorXMLList"), ("coverageProbability", "coverageProbabilityXMLList")


def parse(text):
    """version, number, laboratory, customer, model, identifications, begin, end, quantity by its id."""
    root = ElementTree.fromstring(text)
    parts = root.iterfind(".//{*}results")
    quantities = [quantity(each) for part in parts for each in outer(part) if real_of(each) is not None]
    return SimpleNamespace(
        version=root.get("schemaVersion"),
        number=root.findtext(".//{*}coreData/{*}uniqueIdentifier"),
        laboratory=root.findtext(".//{*}calibrationLaboratory/{*}contact/{*}name/{*}content"),
        customer=root.findtext(".//{*}customer/{*}name/{*}content"),
        model=root.findtext(".//{*}items/{*}item/{*}model"),
        identifications=tuple(each.text for each in root.iterfind(".//{*}items/{*}item/{*}identifications//{*}value")),
        begin=root.findtext(".//{*}coreData/{*}beginPerformanceDate"),
        end=root.findtext(".//{*}coreData/{*}endPerformanceDate"),
        quantity={each.id: each for each in quantities}.__getitem__,
    )


def local(element):
    return element.tag.rpartition("}")[2]


def outer(element):
    """Quantities of results, without those that stand inside another one's remarks."""
    for each in element:
        if local(each) == "quantity":
            yield each
        elif local(each) not in ("measurementMetaData", "influenceConditions", "usedMethods"):
            yield from outer(each)


def real_of(element):
    """Its number or list of numbers."""
    return next((each for each in element if local(each) in ("real", "realListXMLList")), None)


def quantity(element):
    """values in units, expanded, factor and probability: NaN where it is not stated; conformity; covariance, None where there is none."""
    real = real_of(element)
    values = numbers(real, "value", "valueXMLList")
    single = [each for each in real if local(each) != "measurementUncertaintyMultivariateXMLList"]  # it has a coverage of its own
    columns = [numbers(each, "valueXMLList") for each in real.iterfind(".//{*}covarianceXMLList")]
    expanded, factor, probability = (
        np.broadcast_to(next((found for each in single if len(found := numbers(each, *names))), np.nan), values.shape)
        for names in (EXPANDED, FACTORS, PROBABILITIES)
    )
    conformity = [each.text for each in element.iterfind("{*}measurementMetaData//*") if local(each) in ("conformity", "conformityXMLList")]
    return SimpleNamespace(
        id=element.get("id"),
        **dict(values=values, expanded=expanded, factor=factor, probability=probability),
        conformity=tuple(" ".join(conformity).split()),
        covariance=np.array(columns).T if columns else None,
    )


def numbers(element, *names):
    text = next((each.text for each in element.iter() if local(each) in names), "")
    return np.array([float(word) for word in text.split()])


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
country = "DE"
customer = "Customerword"
customer_address = "Customeraddressword"
number = "Numberword-7"
amends = "Amendsword"
item = "Itemword"
manufacturer = "Manufacturerword"
condition = "Conditionword"
place = "Placeword"
performed_at = "customerBranch"
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


def with_fields(data, fields=FIELDS, serial="Serialword"):
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


def words_of(content):
    body = re.sub(r"<style>.*?</style>", " ", page(content), flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


def values_of(rows):
    return {each.name: each for each in rows}


def changed(data, **parts):
    """Data whose session's config has other parts: ``sensor={"model": "X"}``."""
    session = data.fit.session
    changes = {name: replace(getattr(session.config, name), **value) if isinstance(value, dict) else value for name, value in parts.items()}
    problem = data.fit.problem.changed(session=replace(session, config=replace(session.config, **changes)))
    return replace(data, fit=replace(data.fit, problem=problem))


def limited(data):
    fit = data.fit
    return decide(
        data.adopted, [run.file for run in fit.runs], None, fit.against_raw, fit.accelerometer, [], fit.session.config.requirements
    )


# What is on it


def test_every_field_of_the_session_is_on_the_page_and_nothing_else(filled, data):
    words = words_of(filled)
    fields = re.findall(r'^\w+ = (?:"(.*?)"|(\d{4}-\d\d-\d\d))$', FIELDS, flags=re.MULTILINE)
    never = {"DE", "sensor", "guard band", "customerBranch", "Noteoperator"}  # of the DCC, or replaced by a field of the certificate
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


# The Digital Calibration Certificate


@pytest.fixture(scope="module")
def faults(shared):
    """``faults(text)``: what PTB's schema says."""
    etree = pytest.importorskip("lxml.etree", reason="lxml validates the certificate against PTB's schema")
    schema = etree.XMLSchema(etree.parse(str(shared / "wild" / "dcc" / "v3.3.0" / "dcc.xsd"), etree.XMLParser(no_network=True)))

    def said(text):
        schema.validate(etree.fromstring(text.encode("utf-8")))
        return [f"{error.line}: {error.message}" for error in schema.error_log]

    return said


@pytest.mark.parametrize(
    "cut",
    [
        r"^(received|amends|valid_until|next_calibration|manufacturer|role|operator) = .*\n",
        r"\[\[certificate.equipment\]\]\n(\w+ = .*\n)+|\[requirements\](.|\n)*",
        r"^(registers|firmware|conditions|deviations|external|remarks|condition|item|identification) = .*\n",
    ],
)
def test_it_is_valid_by_the_schema_whatever_is_left_out(faults, data, cut):
    assert faults(dcc_text(Certificate(with_fields(data, re.sub(cut, "", FIELDS, flags=re.MULTILINE))))) == []


def test_it_is_read_back_to_the_same_numbers(filled, made):
    found = parse(dcc_text(filled))
    assert (found.version, found.number) == ("3.3.0", "Numberword-7")
    assert (found.laboratory, found.customer) == ("Laboratoryword", "Customerword")
    assert (found.model, found.identifications) == (made.fit.session.config.sensor.model, ("Serialword",))
    assert (found.begin, found.end) == ("2026-11-20", "2026-11-20")
    size = {"ppm": 1e-6, "mrad": 1e-3, "mdps": 1e-3 * DEG, "mg": MG, "°": DEG}
    checked = {name: each for name, each in values_of(filled.results).items() if each.unit in size}
    assert len(checked) > 25
    for name, each in checked.items():
        q = found.quantity("_".join(re.findall(r"\w+", name.replace("-", " "))))
        numbers = [*q.values, *q.expanded, *q.factor, *q.probability]
        assert numbers == pytest.approx([each.value * size[each.unit], each.expanded * size[each.unit], each.factor, 0.95], rel=1e-6)
    model = found.quantity("calibration")
    assert model.values == pytest.approx(made.adopted.vector[:12], rel=1e-15)
    assert model.covariance == pytest.approx(made.adopted.covariance[:12, :12], rel=1e-15)
    assert np.isnan(model.expanded).all()
    assert found.quantity("closure").values == pytest.approx([filled.closure[0][0].value * DEG], rel=1e-12)
    assert found.quantity("closure").conformity == found.quantity("gyroscope_bias_x").conformity == ("pass",)
    assert found.quantity("gyroscope_misalignment_x_to_y").conformity == ()
    assert found.quantity("found_gyroscope_scale_factor_error_y").values == pytest.approx([1e-3], rel=1e-6)
    (factor,) = re.findall(r"<si:coverageFactorXMLList>(.*?)</", dcc_text(filled))
    assert float(factor) == pytest.approx(np.sqrt(21.026), abs=1e-3)  # the 0.95 quantile of chi-square with 12 degrees of freedom


def test_answers_between_pass_and_fail_are_conditional_of_a_guard_band_alone(data, made, faults):
    """The words of ILAC-G8; what is not observed, or not decided, has limits and no answer."""
    value = next(each.measured for *_, of in Certificate(made).statements for each in of if each.measured.key == "closure_deg")
    for limit, answer in ((value.value + value.expanded / 2, "conditionalPass"), (value.value - value.expanded / 2, "conditionalFail")):
        content = Certificate(with_fields(data, FIELDS.replace("upper = 5\n", f"upper = {limit}\n")))
        assert parse(dcc_text(content)).quantity("closure").conformity == (answer,)
    unseen = replace(made, adopted=replace(made.adopted, unobserved=("B_y",)))
    text = dcc_text(Certificate(replace(unseen, decision=limited(unseen))))
    assert faults(text) == []
    assert parse(text).quantity("gyroscope_bias_x").conformity == ("pass",)
    assert "not observed" in (part := re.search(r'id="gyroscope_bias_y".*?id="gyroscope_bias_z"', text, flags=re.DOTALL)[0])
    assert "conformity>" not in part


#: what one of a unit is in SI, by hand: 1 dps is 17.4532925 mrad/s, 1 g is 9.80665 m/s^2
IN_SI = {"ppm": 1e-6, "mrad": 1e-3, "°": 0.0174532925199433, "mdps": 1.74532925199433e-5, "mg": 9.80665e-3}
IN_SI |= {"dps/g": 1.77974053524e-3, "°/√h": 2.90888208665722e-4, "°/h": 4.84813681109536e-6}


def test_each_unit_in_si(filled):
    assert set(IN_SI) == set(UNITS)
    for unit, si in IN_SI.items():
        one = replace(filled)
        vars(one)["results"] = [Fact("one", unit, 1.0, 0.5)]
        q = parse(dcc_text(one)).quantity("one")
        assert (q.values[0], q.expanded[0]) == pytest.approx((si, si * 0.979982), rel=1e-6)


def test_what_people_wrote_stays_text_and_a_draft_has_no_dcc(data, faults):
    text = dcc_text(Certificate(with_fields(data, FIELDS.replace("Customerword", "A & B <b>]]> ü &lt;"), serial="S\x07\x1b[31m<x/>")))
    assert faults(text) == []
    assert parse(text).identifications == ("S\\x07\\x1b[31m<x/>",)
    for lines, says in (
        (['number = "Numberword-7"\n'], r"a draft has no Digital Calibration Certificate; not stated: certificate\.number"),
        (
            ['country = "DE"\n', 'performed_at = "customerBranch"\n'],
            r"has no certificate\.country \(two letters\), certificate\.performed_at",
        ),
    ):
        fields = FIELDS
        for line in lines:
            fields = fields.replace(line, "")
        with pytest.raises(CalibrationError, match=says):
            dcc_text(Certificate(with_fields(data, fields)))


# Files and commands


def test_the_command_writes_report_certificate_and_dcc(simulated, tmp_path, run):
    folder, out, table = tmp_path / "session", tmp_path / "dcc.xml", tmp_path / "r.json"
    shutil.copytree(simulated(segments=16), folder, ignore=shutil.ignore_patterns("truth.json"))
    toml = folder / "session.toml"
    marked, recorded = toml.read_text(encoding="utf-8").split("\n", 1)
    assert marked.startswith("# SIMULATED")
    toml.write_text(recorded.replace("[sensor]\n", "[sensor]\nclock_sigma_ppm = 20\n") + FIELDS, encoding="utf-8")
    words = ("--methods", "raw,least_squares", "--no-explain", "--out", tmp_path / "r.html")
    code, said, _ = run("report", folder, "--certificate", "--dcc", out, "--json", table, *words)
    (tmp_path / "r.html").unlink()
    assert code == 0
    assert str(out) in said
    said = parse(out.read_text(encoding="utf-8")).number, json.loads(table.read_text())["certificate"]["number"]
    assert said == ("Numberword-7", "Numberword-7")
    assert "End of certificate" in (folder / "certificate.html").read_text(encoding="utf-8")
    for more, says in (
        (("--as-found", toml), "--as-found is stated on a certificate: add --certificate"),
        ((folder, "--dcc", tmp_path / "c.xml"), "--dcc names one file"),
        (("--certificate", folder / "certificate.html"), "holds a certificate, which may be issued; move it"),
        (("--dcc", out), "holds a certificate, which may be issued; move it"),
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
