"""The firmware's C against MISRA C:2012: every deviation is in the record, with a reason and its number of places."""

from __future__ import annotations

import sys
from collections import Counter
from subprocess import CompletedProcess

import pytest
from conftest import ROOT

from session.io.errors import CalibrationError, FormatError

sys.path.insert(0, str(ROOT / "firmware"))
import misra_check
from misra_check import Record, differences, read_record, record_text

REASONS = {"10.4": "because", "8.9": "since"}
PLACES = Counter({("10.4", "a.c"): 2, ("8.9", "a.c"): 1, ("8.9", "b.h"): 3})
VERSION = "Cppcheck 2.10"


@pytest.mark.emulation  # some ten seconds, and with the tools that the firmware is built with
def test_the_firmware_deviates_where_the_record_says_and_nowhere_else():
    version, record = misra_check.checker(), read_record(misra_check.RECORD)
    if not version:
        pytest.skip("not installed: cppcheck with its addon misra")
    assert differences(misra_check.all_findings(), record, version) == []


@pytest.mark.emulation
def test_a_violation_that_is_put_into_a_file_is_found(tmp_path):
    if not misra_check.checker():
        pytest.skip("not installed: cppcheck with its addon misra")
    (tmp_path / "x.h").write_text("static inline int twice(int a)\n{\n    if (a > 3)\n        return 7;\n    return a + a;\n}\n")
    for name in ("x", "y"):
        body = "    if (twice(a) > 1 && a)\n        return 2;\n    return a + (1 << a);\n"
        (tmp_path / f"{name}.c").write_text(f'#include "x.h"\nint {name}(int a)\n{{\n{body}}}\n')
    found = misra_check.findings(tmp_path)
    assert [found[rule, file] for rule in ("10.1", "12.1", "15.5") for file in ("x.c", "y.c")] == [1] * 6
    assert (found["15.5", "x.h"], found["12.1", "x.h"]) == (1, 0)  # once, though both include it
    (tmp_path / "x.c").write_text("int x( {\n")
    assert misra_check.findings(tmp_path)["syntaxError", "x.c"] == 1  # a file that Cppcheck does not read is a finding


@pytest.mark.emulation
def test_a_file_on_which_the_addon_ends_with_an_error_is_not_passed_over(tmp_path):
    """Cppcheck 2.10 then says "Bailing out", with exit code 0, and nothing in the file is checked.  Another version may read it."""
    if not misra_check.checker():
        pytest.skip("not installed: cppcheck with its addon misra")
    text = "struct bits {\n    int of[4];\n};\nconst struct bits BITS = {.of = {[1] = 1, [(9) - 7] = 2}};\n"
    (tmp_path / "x.c").write_text(text + "int x(int a) { if (a) return 1; return 0; }\n")
    try:
        found = misra_check.findings(tmp_path)["15.5", "x.c"]
    except CalibrationError as error:
        found = str(error)
    assert found == 1 or str(found).startswith("cppcheck: Bailing out from checking x.c")


@pytest.mark.parametrize(
    ("stdout", "stderr", "code", "said"),
    [
        ("Bailing out from checking x.c since there was an internal error\n", "", 0, "cppcheck: Bailing out from checking x.c"),
        ("cppcheck: error: could not find or open any of the paths given.\n", "", 1, "could not find"),
        ("", "x.c|0|0|internalError\n", 0, "internalError"),
        ("", "", 1, "exit code 1"),
    ],
)
def test_a_checker_that_fails_is_an_error(stdout, stderr, code, said, tmp_path, monkeypatch):
    monkeypatch.setattr(misra_check.subprocess, "run", lambda *words, **how: CompletedProcess(words, code, stdout, stderr))
    with pytest.raises(CalibrationError, match=said):
        misra_check.findings(tmp_path)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (PLACES, []),
        (PLACES + Counter({("10.4", "a.c"): 1}), ["a.c: rule 10.4 is violated in 3 places, 2 of them recorded"]),
        (PLACES + Counter({("10.4", "new.c"): 1}), ["new.c: rule 10.4 is violated in 1 places, 0 of them recorded"]),
        (PLACES - Counter({("8.9", "b.h"): 1}), ["b.h: rule 8.9 is violated in 2 places, 3 are recorded"]),
        (PLACES - Counter({("8.9", "b.h"): 3}), ["b.h: rule 8.9 is violated in 0 places, 3 are recorded"]),
        (PLACES + Counter({("12.1", "a.c"): 1}), ["a.c: rule 12.1 is violated in 1 places, 0 of them", "rule 12.1 has no reason"]),
    ],
)
def test_what_differs_from_the_record_is_one_line(found, said):
    lines = differences(found, Record(VERSION, REASONS, PLACES), VERSION)
    assert len(lines) == len(said)
    assert all(line.startswith(beginning) for line, beginning in zip(lines, said, strict=True))
    assert differences(found, Record(VERSION, REASONS, PLACES), "Cppcheck 2.17") == [line for line in lines if "reason" in line]


def test_the_record_is_read_as_it_was_written_and_keeps_its_reasons(tmp_path):
    path = tmp_path / "record.toml"
    path.write_text(record_text(PLACES, VERSION, REASONS | {"1.1": 'stale, "gone"'}), encoding="utf-8")
    assert read_record(path) == Record(VERSION, REASONS, PLACES)
    path.write_text(record_text(PLACES, "x", {"8.9": "since"}), encoding="utf-8")
    assert differences(PLACES, read_record(path), "x") == ["rule 10.4 has no reason in the record"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is no deviation record"),
        ('checker = "x"\nrule = 3\n', "is no deviation record"),
        ('checker = "x"\n[rule."8.9"]\nreason = "y"\n', "rule 8.9 is incomplete"),
        ('checker = "x"\n[rule."8.9"]\nreason = "y"\nplaces = {"a.c" = 0}\n', "0 is no number of places"),
        ("checker = [", "broken TOML"),
    ],
)
def test_a_record_that_is_none_is_one_line(text, said, tmp_path):
    path = tmp_path / "record.toml"
    path.write_text(text)
    with pytest.raises(FormatError, match=said):
        read_record(path)


def test_every_reason_is_a_sentence():
    reasons = read_record(misra_check.RECORD).reasons
    assert all(reason.endswith(".") and len(reason) > 30 for reason in reasons.values())
