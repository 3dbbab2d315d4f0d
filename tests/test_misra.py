"""The firmware's C against MISRA C:2012: every deviation is in the record, with a reason and its number of places."""

from __future__ import annotations

import sys
from collections import Counter

import pytest
from conftest import ROOT

from session.io.errors import FormatError

sys.path.insert(0, str(ROOT / "firmware"))
import misra_check
from misra_check import Record, differences, read_record, record_text

REASONS = {"10.4": "because", "8.9": "since"}
PLACES = Counter({("10.4", "a.c"): 2, ("8.9", "a.c"): 1, ("8.9", "b.h"): 3})


@pytest.mark.emulation  # some ten seconds, and with the tools that the firmware is built with
def test_the_firmware_deviates_where_the_record_says_and_nowhere_else():
    version, record = misra_check.checker(), read_record(misra_check.RECORD)
    if not version:
        pytest.skip("not installed: cppcheck with its addon misra")
    if version != record.checker:
        pytest.skip(f"the record is that of {record.checker}, this is {version}")
    assert differences(misra_check.all_findings(), record) == []


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
    assert misra_check.findings(tmp_path)["syntaxError", "x.c"] == 1  # nothing is passed over


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
    lines = differences(found, Record("Cppcheck 2.10", REASONS, PLACES))
    assert len(lines) == len(said)
    assert all(line.startswith(beginning) for line, beginning in zip(lines, said, strict=True))


def test_the_record_is_read_as_it_was_written_and_keeps_its_reasons(tmp_path):
    path = tmp_path / "record.toml"
    path.write_text(record_text(PLACES, "Cppcheck 2.10", REASONS | {"1.1": 'stale, "gone"'}), encoding="utf-8")
    assert read_record(path) == Record("Cppcheck 2.10", REASONS, PLACES)
    path.write_text(record_text(PLACES, "x", {"8.9": "since"}), encoding="utf-8")
    assert differences(PLACES, read_record(path)) == ["rule 10.4 has no reason in the record"]


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
