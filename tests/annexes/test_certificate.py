"""The certificate: what is on it, what leaves it a draft, and that nothing is on it that the session does not hold."""

import ast
import gzip
import json
import re
from dataclasses import replace
from datetime import date
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from certified import FIELDS, with_fields

import tinygc
from session.io.certificate import SHAPE
from session.io.errors import FormatError
from session.io.results import Mismatch
from session.io.units import DEG
from tinygc.annexes.certificate import content as content_module
from tinygc.annexes.certificate.content import NOT_STATED, REQUIRED, content_of
from tinygc.annexes.certificate.library import certificate_of, check_before
from tinygc.annexes.certificate.page import page
from tinygc.estimation.repeatability import BiasRepeatability
from tinygc.estimation.sources import coverage_factor, effective_freedom
from tinygc.estimation.verdict import decide
from tinygc.models.linear import LinearModel, field_jacobian
from tinygc.reporting.html.paper import browser_path

FOLDER = Path(content_module.__file__).parent
METHODS = ("raw", "least_squares")


@pytest.fixture(scope="module")
def data(simulated):
    return tinygc.report(simulated(segments=16), explain=False, methods=METHODS).data


@pytest.fixture(scope="module")
def filled(data):
    return content_of(with_fields(data))


def words_of(html: str) -> str:
    body = re.sub(r"<style>.*?</style>", " ", html, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


# What is on it


def test_every_field_of_the_session_is_on_the_page(filled):
    words = words_of(page(filled))
    fields = re.findall(r'^\w+ = (?:"(.*?)"|(\d{4}-\d\d-\d\d))$', FIELDS, flags=re.MULTILINE)
    never = {"DE", "sensor", "guard band", "customerBranch", "Noteoperator"}  # of the DCC, or replaced by a field of the certificate
    for value in {a or b for a, b in fields} - never:
        assert value in words, value
    assert filled.draft == filled.missing == ()
    assert "Calibration certificate" in words
    assert "DRAFT" not in words
    assert NOT_STATED not in words
    assert "End of certificate Numberword-7" in words


def test_the_number_and_the_page_are_on_every_sheet(filled):
    html = page(filled)
    assert 'counter(page) " of " counter(pages)' in html
    running = re.search(r'@bottom-left\{content:"(.*?)"\}', html)[1]
    spelled = re.sub(r"\\([0-9a-f]+) ", lambda found: chr(int(found[1], 16)), running)
    assert spelled == "certificate number Numberword-7"


def test_a_validity_is_stated_only_where_it_is_asked_for(data):
    without = re.sub(r"^(valid_until|next_calibration) = .*\n", "", FIELDS, flags=re.MULTILINE)
    words = words_of(page(content_of(with_fields(data, without))))
    assert not re.search(r"[Vv]alid until|Next calibration", words)


def test_the_results_are_those_of_the_report_with_their_k(data, filled):
    quantities = {f"gyroscope {q.word} {q.component}": q for q in data.adopted.quantities}
    rows = {f"{row.words} {part}": each for row in filled.results for part, each in zip(row.parts, row.values, strict=True)}
    for name, q in quantities.items():
        more = 1e3 if q.unit == "dps" else 1.0
        assert rows[name].value == pytest.approx(q.value * more)
        slope = field_jacobian(data.adopted.vector)[list(quantities).index(name)]
        variances, freedoms = zip(*((float(each.variance(slope[None])[0]), each.freedom) for each in data.fit.sources), strict=True)
        moved = float(data.fit.allowed.of(slope[None])[0])
        assert q.factor == pytest.approx(coverage_factor(effective_freedom([*variances, moved**2], [*freedoms, np.inf])))
        unit = q.moved / moved
        assert q.sigma == pytest.approx(unit * np.sqrt(sum(variances) + moved**2))
        assert rows[name].expanded == pytest.approx(q.expanded * more)  # one U on all pages
    closure, floor = filled.closure[0]
    assert closure.value == pytest.approx(np.sqrt(np.mean(np.sum(data.adopted.angles[:, :2] ** 2, axis=1))) / DEG)
    assert floor == pytest.approx(data.adopted.floor_rms / DEG)


def test_sources_that_are_told_apart_give_their_own_k(data):
    covariance = data.adopted.covariance
    sources = tuple(content_module.Source(name, "A", 4.0, covariance / 2) for name in ("first", "second"))
    told = replace(data, adopted=replace(data.adopted, sources=sources, allowed=None))
    found = content_of(told)
    assert found.results[0].values[0].factor == pytest.approx(2.306004, rel=1e-5)  # Student's t of 8 degrees of freedom
    assert "Contributions: first (A), second (A)." in " ".join(found.uncertainty)


def test_the_bias_at_any_switch_on_has_its_spread(data):
    spread = BiasRepeatability(np.full(3, 0.1 * DEG), "three sessions")
    found = content_of(replace(data, fit=replace(data.fit, repeatability=spread)))
    rows = {row.words: row.values[0] for row in found.results}
    usual, any_time = rows["gyroscope bias"], rows["gyroscope bias at any switch-on"]
    assert any_time.value == usual.value
    # b = -E^-1 B, E near the identity
    assert any_time.sigma == pytest.approx(np.hypot(usual.sigma, np.sqrt(2) * 100), rel=0.02)
    assert any("100, 100, 100 mdps (one sigma; three sessions)" in remark for remark in found.remarks)


def test_as_found_are_the_errors_that_the_old_calibration_leaves(data):
    new = LinearModel.from_vector(data.adopted.vector)
    gain, zero = np.diag([1.001, 1.0, 1.0]), np.array([0.0, 0.002, 0.0])
    # the old one makes of each rate w: gain w + zero
    old = LinearModel(gain @ new.E, gain @ new.B + zero)
    found = content_of(data, ("old.json", old)).as_found
    rows = {f"{row.words} {part}": each for row in found for part, each in zip(row.parts, row.values, strict=True)}
    assert rows["gyroscope scale factor error x"].value == pytest.approx(1000, abs=1e-6)
    assert rows["gyroscope scale factor error y"].value == pytest.approx(0, abs=1e-6)
    assert rows["gyroscope bias y"].value == pytest.approx(2 / DEG, rel=1e-9)
    same = content_of(data, ("same.json", new)).as_found
    assert max(abs(each.value) for row in same for each in row.values) < 1e-6
    usual = content_of(data).results
    for row, other in zip(same[:1], usual[:1], strict=True):
        for each, before in zip(row.values, other.values, strict=True):
            assert each.sigma == pytest.approx(before.sigma, rel=0.03)


def test_the_statement_of_conformity_says_rule_limits_answer_and_risk(filled):
    words = words_of(page(filled))
    assert "Statement of conformity: Specificationword" in words
    assert "Guard bands of w = 1 U at each limit" in words
    answers = {each.measured.key: each.answer for each in filled.conformity}
    assert set(answers.values()) == {"pass"}
    assert len(answers) == 7


def test_fit_report_and_certificate_have_one_u_and_one_decision(data):
    """Limits within U with the effect that the model lacks, and beyond U without it: no page may decide."""
    q = next(q for q in data.adopted.quantities if (q.word, q.component) == ("scale factor error", "x"))
    alone = 2 * np.sqrt(q.sigma**2 - q.moved**2)
    near = q.value + (alone + q.expanded) / 2
    fields = FIELDS + f"[requirements.gyro_scale_factor_error_x_ppm]\nlower = {q.value - 1e5}\nupper = {near}\n"
    made = with_fields(data, fields)
    files, fit = [run.file for run in made.fit.runs], made.fit
    by_fit = decide(fit.judged, files, None, fit.against_raw, fit.accelerometer, [], fit.requirements)
    key = "gyro_scale_factor_error_x_ppm"
    (one,) = (each for each in by_fit.conformities if each.measured.key == key)
    (other,) = (each for each in content_of(made).conformity if each.measured.key == key)
    assert one.to_json() == other.to_json()
    assert one.measured.expanded == pytest.approx(q.expanded)
    assert one.answer == "not decided"


def limited(made, limit_deg):
    runs, fit = [run.file for run in made.fit.runs], made.fit
    return decide(made.adopted, runs, limit_deg, fit.against_raw, fit.accelerometer, [], fit.requirements)


def test_a_limit_of_the_command_is_no_part_of_the_customers_specification(data):
    made = with_fields(data, FIELDS + "[requirements.attitude_60s_deg]\nupper = 9\n")
    found = content_of(replace(made, decision=limited(made, 5.0)))
    closure, bias, attitude = found.statements
    assert {each.measured.key for each in closure.conformities} <= {"closure_deg", "closure_run_deg"}
    assert "Specificationword" not in closure.reference
    assert closure.rule.startswith("Simple acceptance")
    assert (bias.reference, attitude.reference) == ("Specificationword", "Specificationword")
    assert bias.rule.startswith("Guard bands")
    words = words_of(page(found))
    assert words.count("Decision rule (ISO/IEC 17025:2017, 7.8.6): Simple acceptance") == 2
    assert "none: an uncertainty" in words


class Allowed:
    """Another stand-in for the effects that a recording does not exclude: each quantity moves by 100 ppm, mrad / 10, or 100 urad/s."""

    def of(self, slope):
        return np.full(len(slope), 1e-4)


def test_u_holds_the_effect_that_the_model_lacks(data):
    """In the results, in the bias at any switch-on, and in what is held against limits: 1e-4 in SI, beside the fit's own sigma."""
    made = with_fields(data)
    plain = content_of(replace(made, adopted=replace(made.adopted, allowed=None)))
    lacking = replace(made, adopted=replace(made.adopted, allowed=Allowed()))
    found = content_of(replace(lacking, decision=limited(lacking, 5.0)))

    def named(content):
        return {f"{row.words} {part}": one for row in content.results for part, one in zip(row.parts, row.values, strict=True)}

    before, after = named(plain), named(found)
    moved = {"gyroscope scale factor error x": 100.0, "gyroscope misalignment x to y": 0.1, "gyroscope bias z": 1e-4 / DEG * 1e3}
    for name, more in moved.items():
        assert after[name].sigma == pytest.approx(np.hypot(before[name].sigma, more), rel=1e-6)
        assert after[name].freedom >= before[name].freedom
        assert after[name].value == before[name].value
    stated = {each.measured.key: each.measured.sigma for each in found.conformity}
    assert stated["gyro_bias_z_mdps"] == pytest.approx(after["gyroscope bias z"].sigma, rel=1e-12)


def test_the_operator_of_the_notes_signs_where_the_certificate_names_none(data):
    words = words_of(page(content_of(with_fields(data, FIELDS.replace('operator = "Operatorword"\n', "")))))
    assert "Noteoperator calibrated by" in words


def test_an_accelerometer_that_was_taken_as_given_is_no_result(data):
    given = tinygc.fit(data.fit.session.folder, methods=("least_squares",), accelerometer="given").result
    rows = [row.words for row in content_of(replace(data, fit=given)).results]
    assert not any("accelerometer" in words for words in rows)
    assert any("accelerometer bias" in row.words for row in content_of(data).results)


def test_a_clock_that_is_in_no_uncertainty_is_said_at_the_clock(data):
    def words(clock="board", **stated):
        session, options = data.fit.session, replace(data.fit.options, clock=clock)
        config = replace(session.config, sensor=replace(session.config.sensor, **stated))
        problem = data.fit.problem.changed(session=replace(session, config=config))
        found = content_of(replace(data, fit=replace(data.fit, problem=problem, options=options)))
        return next(field.text for field in found.traceability if field.label == "Clock")

    assert "whose clock's error is not known" in words()
    assert "whose clock is known to 20 ppm (k = 1), which is in U" in words(clock_sigma_ppm=20.0)
    assert "not known" not in words(clock_sigma_ppm=0.0)
    off = words(clock_sigma_ppm=12.0, clock_ratio=1.0045)
    assert "4500 ± 12 ppm fast by the computer's, a deviation that is not corrected" in off
    assert "k = 1" not in off
    by_computer = words("arrivals", clock_sigma_ppm=12.0)
    assert by_computer.startswith("time by the computer's second: the stamps of the item's board, divided by")
    assert "the two clocks, which is known to 12 ppm (k = 1), which is in U" in by_computer


def test_the_nominal_rate_is_the_models_and_not_the_boards_own(data):
    session = data.fit.session
    config = replace(session.config, sensor=replace(session.config.sensor, model="ASM330LHH", odr_hz=207.064))
    problem = data.fit.problem.changed(session=replace(session, config=config))
    found = content_of(replace(data, fit=replace(data.fit, problem=problem)))
    assert any(field.label == "Data rate" and field.text.startswith("208 Hz nominal, ") for field in found.item)


# A draft


@pytest.mark.parametrize("key", sorted(REQUIRED))
def test_each_required_field_that_is_missing_leaves_a_draft_and_is_named(data, key):
    text = re.sub(rf"^{key} = .*\n", "", FIELDS, count=2 if key == "number" else 0, flags=re.MULTILINE)
    found = content_of(with_fields(data, text))
    assert f"certificate.{key}" in found.missing
    words = words_of(page(found))
    assert "DRAFT: this is no calibration certificate" in words
    assert f"certificate.{key}" in words
    assert "End of the draft" in words


def test_a_bare_session_is_a_draft_that_says_all_that_is_missing(data):
    found = certificate_of(data)
    keys = {f"certificate.{key}" for key in REQUIRED} | {f"certificate.traceability.{key}" for key in ("gravity", "clock", "angle")}
    assert keys <= set(found.missing)
    assert "certificate.calibrated" in found.missing  # the log's file alone tells the day
    assert found.line.startswith("certificate: a draft; not stated: certificate.laboratory")
    assert found.to_json() == {"number": None, "draft": list(found.draft), "missing": list(found.missing)}


def test_a_unit_without_a_serial_number_is_no_identified_item(data):
    assert content_of(with_fields(data, serial="")).missing == ("sensor.serial",)


def test_what_is_unsound_or_has_no_sensor_is_a_draft_whatever_is_filled_in(data):
    standin = FIELDS.replace('source = "sensor"', 'source = "stand-in"')
    assert "no sensor" in content_of(with_fields(data, standin)).draft[0]
    unsound = replace(data.decision, unsound=["closure of the fitted segments: p = 0.001, more than noise allows"])
    failed = content_of(replace(with_fields(data), decision=unsound))
    assert failed.draft == (
        "the calibration does not pass its own check: closure of the fitted segments: p = 0.001, more than noise allows",
    )


def test_a_simulated_recording_is_a_draft_that_says_so(data):
    """Beside the session lies what the simulation keeps of its truth; the fields' folder has it not."""
    assert "the recording is simulated: truth.json lies beside it" in content_of(data).draft
    assert content_of(with_fields(data)).draft == ()


@pytest.mark.parametrize("packed", [False, True])
def test_a_log_whose_first_line_says_simulated_is_a_draft(data, tmp_path, packed):
    made = with_fields(data)
    log = tmp_path / ("log.csv.gz" if packed else "log.csv")
    text = b"# SIMULATED by another program\nt_us,gx_dps\n"
    log.write_bytes(gzip.compress(text) if packed else text)
    session = made.fit.session
    logs = (replace(session.logs[0], path=log), *session.logs[1:])
    problem = made.fit.problem.changed(session=replace(session, logs=logs))
    assert content_of(replace(made, fit=replace(made.fit, problem=problem))).draft == (
        f"the recording is simulated: the first line of {log.name} says so",
    )


def test_a_clock_that_is_not_known_is_a_draft(data):
    made = with_fields(data)
    session = made.fit.session
    config = replace(session.config, sensor=replace(session.config.sensor, clock_sigma_ppm=None))
    problem = made.fit.problem.changed(session=replace(session, config=config))
    assert any("clock's error is not known" in why for why in content_of(replace(made, fit=replace(made.fit, problem=problem))).draft)


def test_standards_and_the_day_of_the_computation_are_on_the_page(data):
    found = content_of(with_fields(data))
    assert [(each.name, each.certificate) for each in found.equipment[-2:]] == [
        ("standard of force: gravity", "Gravityword"),
        ("standard of time: clock", "Clockword"),
    ]
    assert next(field.text for field in found.dates if field.label == "Computed") == data.made
    words = words_of(page(found))
    assert f"Computed {data.made}" in words
    assert "Component: value ± U" in words


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("due = 2027-05-31", "due = 2026-11-19"), "equipment was overdue on the day of the calibration: Equipmentword"),
        (("calibrated = 2026-11-20\nissued = 2026-11-23", "issued = 2026-11-19"), "issued is 2026-11-19, before calibrated, 2026-11-20"),
        (
            ("received = 2026-11-16\ncalibrated = 2026-11-20", "received = 2026-11-21"),
            "calibrated is 2026-11-20, before received, 2026-11-21",
        ),
    ],
)
def test_days_that_do_not_go_together_leave_a_draft(data, change, says):
    text = FIELDS.replace(*change)
    assert text != FIELDS
    assert content_of(with_fields(data, text)).draft == (says,)


def test_a_sensor_without_a_model_is_no_identified_item(data):
    made = with_fields(data)
    problem = made.fit.problem
    session = replace(problem.session, config=replace(problem.session.config, model_given=False))
    nameless = replace(made, fit=replace(made.fit, problem=problem.changed(session=session)))
    assert content_of(nameless).missing == ("sensor.model",)


DAYS = ("received", "calibrated", "issued", "valid_until", "next_calibration")


@pytest.mark.parametrize(("first", "second"), [(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (1, 3), (1, 4), (2, 3), (2, 4)])
def test_every_two_days_are_in_order(first, second):
    for days, right in (((20, 20), True), ((21, 20), False)):
        table = {DAYS[first]: date(2026, 11, days[0]), DAYS[second]: date(2026, 11, days[1])}
        if right:
            SHAPE.check(table, "certificate")
            continue
        with pytest.raises(Mismatch, match=rf"certificate.{DAYS[second]} is 2026-11-20, expected no day before {DAYS[first]}, 2026-11-21"):
            SHAPE.check(table, "certificate")


def test_a_text_that_no_page_has_room_for_is_refused():
    SHAPE.check({"customer": "x" * 300}, "certificate")
    for text in ("x" * 301, "a\nb", " "):
        with pytest.raises(Mismatch, match=r"certificate.customer is .*, expected text on one line, of at most 300 characters"):
            SHAPE.check({"customer": text}, "certificate")


def test_an_item_that_does_not_conform_gets_its_certificate(data):
    """That it fails is a result; the uncertainties hold all the same."""
    found = content_of(with_fields(data, FIELDS.replace("upper = 5\n", "upper = 0.0001\n")))
    assert found.draft == ()
    assert found.conformity[0].answer == "fail"
    assert " FAIL " in words_of(page(found))


def test_uncertainties_that_are_widened_say_by_how_much(data):
    found = content_of(replace(data, fit=replace(data.fit, widened=2.25)))
    assert "standard uncertainties are multiplied by 1.50" in " ".join(found.uncertainty)


def test_a_day_of_the_recording_that_differs_from_the_stated_one_is_said(data):
    found = content_of(with_fields(data, FIELDS.replace("date = 2026-11-20", "date = 2026-11-19")))
    assert next(field.text for field in found.dates if field.label == "Calibrated") == "2026-11-20 (recorded 2026-11-19)"


# Nothing else


def literals(path: Path) -> str:
    """Texts of a module's code: its strings, docstrings and comments left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    said = {id(node.body[0].value) for node in ast.walk(tree) if isinstance(node, documented) and isinstance(node.body[0], ast.Expr)}
    texts = [
        node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said
    ]
    return " ".join(texts)


def test_no_word_of_the_page_is_from_nowhere(data):
    """Each word stands in session.toml, in a text of this annex or of a module whose words it takes over, or is a doubt of the verdict."""
    made = with_fields(data)
    words = words_of(page(content_of(made)))
    session = (data.fit.session.folder / "session.toml").read_text(encoding="utf-8") + FIELDS + " Serialword "
    root = Path(tinygc.__file__).parent
    modules = [FOLDER / "content.py", FOLDER / "page.py", root / "models/linear.py", root / "reporting/html/evidence.py"]
    modules += [root / "estimation/requirements.py", root / "estimation/accelerometer.py"]
    modules += [root / f"{name}.py" for name in ("estimation/stated_noise", "estimation/assembly", "closure/floor", "closure/uncertainty")]
    texts = " ".join([*map(literals, modules), (FOLDER / "templates/certificate.html").read_text(encoding="utf-8")])
    texts += " ".join([*made.decision.doubts, *(run.file for run in made.fit.runs), "xy xz yz zx"])
    known = set(re.findall(r"[^\W\d_]{2,}", (session + texts).lower()))
    assert set(re.findall(r"[^\W\d_]{2,}", words.lower())) - known == set()


def test_numbers_of_the_page_are_computed_or_given(data):
    """Two sessions with other fields differ in nothing but those."""
    first, second = (words_of(page(content_of(with_fields(data, fields)))) for fields in (FIELDS, FIELDS.replace("word", "other")))
    assert first.replace("word", "other").lower() == second.replace("word", "other").lower()


# Files and commands


@pytest.mark.broad
def test_the_command_writes_report_and_certificate(simulated, tmp_path, run):
    folder = simulated(segments=16)
    form, table = tmp_path / "c.html", tmp_path / "r.json"
    words = ("--methods", "raw,least_squares", "--no-explain", "--out", tmp_path / "r.html", "--certificate", form, "--json", table)
    code, out, err = run("report", folder, *words)
    assert code == 0
    assert str(form) in out
    assert "certificate: a draft; not stated: certificate.laboratory" in err
    assert "DRAFT" in form.read_text(encoding="utf-8")
    assert json.loads(table.read_text())["certificate"]["number"] is None
    assert "certificate" in (tmp_path / "r.html").read_text(encoding="utf-8")  # the report says that it is none


def test_what_the_options_cannot_do_is_one_line(simulated, tmp_path, run):
    folder = simulated(segments=16)
    for words, says in (
        (("--as-found", folder / "session.toml"), "--as-found is stated on a certificate: add --certificate"),
        ((folder, "--certificate", tmp_path / "c.html"), "of several folders each gets its certificate.html"),
        ((folder, "--dcc", tmp_path / "c.xml"), "--dcc names one file"),
    ):
        code, _, err = run("report", folder, *words, "--no-explain", "--methods", "raw,least_squares", "--out", tmp_path / "r.html")
        assert code == 2
        assert says in err


def test_what_a_certificate_would_fail_at_is_said_before_the_fit(data, tmp_path, run):
    """The logs are missing, and nothing asks for them."""
    made, form, digital = with_fields(data), tmp_path / "c.html", tmp_path / "c.xml"
    found = certificate_of(made)
    found.save(form)
    found.save_dcc(digital)
    folder = made.fit.session.folder
    for words in (("--certificate", form), ("--dcc", digital)):
        code, _, err = run("report", folder, *words, "--out", tmp_path / "r.html")
        assert code == 2
        assert "holds a certificate, which may be issued; move it" in err
    code, _, err = run("report", folder, "--dcc", tmp_path / "other.xml", "--out", tmp_path / "r.html")
    assert code == 2
    assert "--dcc: a draft has no Digital Calibration Certificate; not stated: certificate.laboratory" in err
    assert not (tmp_path / "r.html").exists()
    certificate_of(data).save(form)
    check_before(folder, form, None)  # a draft may be written again


def test_another_kind_of_model_is_not_stated_as_found(data, tmp_path):
    path = tmp_path / "model.json"
    path.write_text("{}")
    with pytest.raises(FormatError):
        certificate_of(data, path)


@pytest.mark.browser
@pytest.mark.skipif(browser_path() is None, reason="needs Chromium")
def test_it_prints_on_two_sheets(data, tmp_path):
    made = certificate_of(with_fields(data))
    _, pdf = made.save(tmp_path / "certificate.html", pdf=True)
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", pdf.read_bytes())) == 2
