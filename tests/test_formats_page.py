"""docs/formats.md is the contract: whatever key a command writes, and whatever key the session file may hold, stands on that page."""

import json
import shutil
from pathlib import Path

import pytest
from feature import all_features
from formats_page import EFFECTS, PAGE, PAGES, SCHEMA, keys_on_page, maker, rows, section, strangers, told

from tinygc.effects import catalogue

ROOT = Path(__file__).resolve().parent.parent
#: what is no JSON
TOML_AND_FRAMES = {
    "tinygc-session/1",
    "tinygc-frame/1",
    "tinygc-defaults/1",
    "tinygc-table/1",
    "tinygc-make/1",
}


def assert_on_page(table, schema):
    assert table["schema"] == schema
    assert not strangers(table), f"docs/formats.md, {schema}, or its schema, lacks {', '.join(sorted(set(strangers(table))))}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory, simulated):
    """A session with a closure run, fitted; what fit said is beside it."""
    folder = tmp_path_factory.mktemp("formats") / "session"
    shutil.copytree(simulated(), folder)
    words = ("--methods", "least_squares,tinygc,tinygc_denoised")
    told(folder.parent / "fit.json", "fit", folder, *words, "--physics", "gyro.thermal_bias")
    return folder


def test_every_format_of_the_code_has_its_section():
    code = "".join(path.read_text(encoding="utf-8") for part in ("session", "tinygc", "firmware") for path in (ROOT / part).rglob("*.py"))
    written = set(SCHEMA.findall(code))
    missing = written - set(SCHEMA.findall(PAGE))
    assert not missing, f"edit docs/formats/*.md, which lack {', '.join(sorted(missing))}"
    if all_features():
        texts = {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in PAGES}
        left = {f"edit {path}: nothing writes {name}" for path, text in texts.items() for name in set(SCHEMA.findall(text)) - written}
        assert not left, "\n".join(sorted(left))
    for schema in set(SCHEMA.findall(PAGE)) - TOML_AND_FRAMES:
        assert ("schema",) in keys_on_page(schema)


def test_the_effects_of_the_page_are_those_of_the_catalogue():
    page = {row[0].strip("`"): row for row in rows("Effects") if "…" not in row[0]}
    assert set(catalogue()) == {name for name, row in page.items() if "(truth file)" not in row[1]}
    for name, effect in catalogue().items():
        if name != "earth.rotation":  # said as a latitude
            assert effect.parameter.name in EFFECTS[name]


def test_the_tables_of_the_pages_are_those_of_the_records():
    for path, text in maker().pages().items():
        assert path.read_text(encoding="utf-8") == text, "python docs/make_schemas.py"


def test_fit_and_every_file_that_it_leaves(folder):
    table = json.loads((folder.parent / "fit.json").read_text(encoding="utf-8"))
    assert_on_page(table, "tinygc-fit/2")
    assert {"physics", "tinygc_physics", "tinygc_denoised"} <= set(table["methods"])
    assert table["closure_runs"]
    files = {path.name: json.loads(path.read_text(encoding="utf-8")) for path in (folder / "fit").iterdir()}
    assert {name for name in files if not name.startswith("model_")} == {"fit.json"}
    assert_on_page(files.pop("fit.json"), "tinygc-fit/2")
    kinds = set()
    for model in files.values():
        assert_on_page(model, "tinygc-model/1")
        kinds.add(model["kind"])
    assert kinds == {"linear", "tinygc", "tinygc_denoised", "physics", "tinygc_physics"}


def test_explain_where_nothing_is_missing_and_plan(folder, tmp_path):
    table = told(tmp_path / "x.json", "explain", folder, "--no-pictures", "--out", tmp_path)
    assert_on_page(table, "tinygc-explain/2")
    assert table["detection_limits"]
    assert_on_page(told(tmp_path / "x.json", "check", folder, "--plan"), "tinygc-plan/2")


def test_apply_and_the_header_of_its_log(folder, tmp_path):
    model, (log,) = folder / "fit" / "model_tinygc.json", folder.glob("log*")
    for unit in ("rps", "dps"):
        table = told(tmp_path / "x.json", "apply", model, log, "-o", tmp_path / f"{unit}.csv", "--unit", unit)
        assert_on_page(table, "tinygc-apply/1")
        header = (tmp_path / f"{unit}.csv").read_text(encoding="utf-8").split("\n")[0]
        rates = ",".join(f"g{axis}_{unit}" for axis in "xyz")
        assert header == f"t_ns,{rates},ax_mps2,ay_mps2,az_mps2,temp_c,gyro_calibrated,accel_calibrated"
        assert rates in section("Logs")
    assert "t_ns,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2,temp_c" in section("Logs")


def test_simulate_and_its_truth(tmp_path):
    table = told(tmp_path / "x.json", "simulate", "--out", tmp_path / "s", "--segments", 1, "--closure", 12, "--odr-hz", 104)
    assert_on_page(table, "tinygc-simulate/1")
    assert_on_page(json.loads((tmp_path / "s" / "truth.json").read_text(encoding="utf-8")), "tinygc-truth/1")


def test_replay(folder, tmp_path):
    (log,) = folder.glob("log*")
    assert_on_page(told(tmp_path / "x.json", "import", log, "--out", tmp_path / "s"), "tinygc-replay/2")
