"""The Digital Calibration Certificate: valid by PTB's schema, and read back to the same numbers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from certified import FIELDS, with_fields
from dcc_reader import parse, read

import tinygc
from session.io.errors import CalibrationError
from session.io.units import DEG, MG
from tinygc.annexes.certificate.content import ResultRow, content_of
from tinygc.annexes.certificate.dcc_file import UNITS, dcc_text
from tinygc.annexes.certificate.library import certificate_of
from tinygc.estimation.requirements import Measured
from tinygc.estimation.verdict import decide
from tinygc.models.linear import LinearModel

METHODS = ("raw", "least_squares")


@pytest.fixture(scope="module")
def data(simulated):
    return with_fields(tinygc.report(simulated(segments=16), explain=False, methods=METHODS).data)


@pytest.fixture(scope="module")
def written(data):
    new = LinearModel.from_vector(data.adopted.vector)
    return content_of(data, ("old.json", LinearModel(1.001 * new.E, new.B)))


@pytest.fixture(scope="module")
def schema(shared):
    etree = pytest.importorskip("lxml.etree", reason="lxml validates the certificate against PTB's schema")
    return etree.XMLSchema(etree.parse(str(shared / "wild" / "dcc" / "v3.3.0" / "dcc.xsd"), etree.XMLParser(no_network=True)))


def faults(schema, text: str) -> list[str]:
    from lxml import etree

    schema.validate(etree.fromstring(text.encode("utf-8")))
    return [f"{error.line}: {error.message}" for error in schema.error_log]


def test_it_is_valid_by_the_schema(schema, written):
    assert faults(schema, dcc_text(written)) == []


@pytest.mark.parametrize("name", ["receipt", "amends", "equipment", "requirements", "operator", "most"])
def test_it_is_valid_whatever_is_left_out(schema, data, name):
    cut = {
        "receipt": r"^received = .*\n",
        "amends": r"^(amends|valid_until|next_calibration|manufacturer|role) = .*\n",
        "equipment": r"\[\[certificate.equipment\]\]\n(\w+ = .*\n)+",
        "requirements": r"\[requirements\](.|\n)*",
        "operator": r"^operator = .*\n",
        "most": r"^(registers|firmware|conditions|deviations|external|remarks|condition|item|identification) = .*\n",
    }[name]
    fields = re.sub(cut, "", FIELDS, flags=re.MULTILINE)
    assert fields != FIELDS
    text = dcc_text(content_of(with_fields(data, fields)))
    assert faults(schema, text) == []


def test_it_is_read_back_to_the_same_numbers(written, data, tmp_path):
    path = certificate_of(data).save_dcc(tmp_path / "dcc.xml")
    found = read(path)
    assert (found.version, found.number) == ("3.3.0", "Numberword-7")
    assert (found.laboratory, found.customer) == ("Laboratoryword", "Customerword")
    assert (found.model, found.identifications) == (data.fit.session.config.sensor.model, ("Serialword",))
    assert (found.begin, found.end) == ("2026-11-20", "2026-11-20")
    size = {"ppm": 1e-6, "mrad": 1e-3, "mdps": 1e-3 * DEG, "mg": MG, "°": DEG}
    checked = 0
    for row in written.results:
        for part, each in zip(row.parts, row.values, strict=True):
            if each.unit not in size:
                continue
            q = found.quantity("_".join(re.findall(r"\w+", f"{row.words} {part}".replace("-", " "))))
            assert q.values == pytest.approx([each.value * size[each.unit]], rel=1e-12)
            assert q.expanded == pytest.approx([each.expanded * size[each.unit]], rel=1e-12)
            assert q.factor == pytest.approx([each.factor], abs=1e-6)
            assert q.probability == pytest.approx([0.95])
            checked += 1
    assert checked > 25
    model = found.quantity("calibration")
    assert model.values == pytest.approx(data.adopted.vector[:12], rel=1e-15)
    assert model.covariance == pytest.approx(data.adopted.covariance[:12, :12], rel=1e-15)
    assert np.isnan(model.expanded).all()
    closure, _ = written.closure[0]
    assert found.quantity("closure").values == pytest.approx([closure.value * DEG], rel=1e-12)


def test_conformity_and_as_found_are_in_it(written):
    found = parse(dcc_text(written))
    assert found.quantity("closure").conformity == ("pass",)
    assert found.quantity("gyroscope_bias_x").conformity == ("pass",)
    assert found.quantity("gyroscope_misalignment_x_to_y").conformity == ()
    assert found.quantity("found_gyroscope_scale_factor_error_y").values == pytest.approx([1e-3], rel=1e-6)


def test_a_value_in_a_guard_band_is_a_conditional_answer(data):
    value = next(each.measured for each in content_of(data).conformity if each.measured.key == "closure_deg")
    for limit, answer in ((value.value + value.expanded / 2, "conditionalPass"), (value.value - value.expanded / 2, "conditionalFail")):
        content = content_of(with_fields(data, FIELDS.replace("upper = 5\n", f"upper = {limit}\n")))
        assert content.draft == ()
        assert parse(dcc_text(content)).quantity("closure").conformity == (answer,)


def test_what_is_not_observed_or_not_decided_has_limits_and_no_answer(data, schema):
    """The words of ILAC-G8 for what is between PASS and FAIL are those of a guard band."""
    made = with_fields(data)
    unseen = replace(made.adopted, unobserved=("B_y",))
    decision = decide(unseen, [run.file for run in made.fit.runs], None, made.fit.against_raw, None, [], made.fit.requirements)
    text = dcc_text(content_of(replace(made, adopted=unseen, decision=decision)))
    assert faults(schema, text) == []
    found = parse(text)
    assert found.quantity("gyroscope_bias_x").conformity == ("pass",)
    assert "not observed" in re.search(r'id="gyroscope_bias_y".*?</dcc:quantity>', text, flags=re.DOTALL)[0]
    assert "conformity>" not in re.search(r'id="gyroscope_bias_y".*?id="gyroscope_bias_z"', text, flags=re.DOTALL)[0]
    narrow = FIELDS.replace('rule = "guard band"', "least_ratio = 1000000").replace("upper = 5\n", "lower = 0\nupper = 5\n")
    content = content_of(with_fields(data, narrow.replace("[requirements.accel_bias_mg]\nupper = 100\n", "")))
    assert {each.answer for each in content.conformity} == {"not decided"}
    text = dcc_text(content)
    assert faults(schema, text) == []
    assert "conformity>" not in text


#: what one of a unit is in SI, by hand: 1 dps is 17.4532925 mrad/s, 1 g is 9.80665 m/s^2
IN_SI = {
    "ppm": 1e-6,
    "mrad": 1e-3,
    "°": 0.0174532925199433,
    "mdps": 1.74532925199433e-5,
    "mg": 9.80665e-3,
    "dps/g": 1.77974053524e-3,
    "°/√h": 2.90888208665722e-4,
    "°/h": 4.84813681109536e-6,
}


@pytest.mark.parametrize("unit", IN_SI)
def test_each_unit_in_si(written, unit):
    one = replace(written, results=[ResultRow("one", ("",), (Measured("", "one", unit, 1.0, 0.5),))])
    q = parse(dcc_text(one)).quantity("one")
    assert q.values == pytest.approx([IN_SI[unit]], rel=1e-9)
    assert q.expanded == pytest.approx([IN_SI[unit] * 0.979982], rel=1e-6)
    assert set(IN_SI) == set(UNITS)


def test_the_ellipsoid_of_the_twelve_holds_95_percent(written):
    """The root of the 0.95 quantile of chi-square with 12 degrees of freedom, 21.026."""
    (factor,) = re.findall(r"<si:coverageFactorXMLList>(.*?)</", dcc_text(written))
    assert float(factor) == pytest.approx(4.585, abs=1e-3)


def test_what_people_wrote_stays_text(data, schema):
    fields = FIELDS.replace("Customerword", "A & B <b>]]> ü &lt;")
    text = dcc_text(content_of(with_fields(data, fields, serial="S\x07\x1b[31m<x/>")))
    assert faults(schema, text) == []
    found = parse(text)
    assert found.identifications == ("S\\x07\\x1b[31m<x/>",)


def test_a_draft_and_what_the_schema_requires_are_asked_for(data):
    with pytest.raises(CalibrationError, match=r"a draft has no Digital Calibration Certificate; not stated: certificate\.number"):
        dcc_text(content_of(with_fields(data, FIELDS.replace('number = "Numberword-7"\n', ""))))
    with pytest.raises(CalibrationError, match=r"lacks certificate\.country \(two letters\), certificate\.performed_at"):
        dcc_text(content_of(with_fields(data, FIELDS.replace('country = "DE"\n', "").replace('performed_at = "customerBranch"\n', ""))))


# Certificates of others
