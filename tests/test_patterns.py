"""No text makes a pattern of the product take more than a time in proportion to its length."""

import re

import pytest
from patterns import Used, patterns, worse_than_linear


@pytest.mark.parametrize("pattern", [r"(?:a|a)*b", r"\d+,\d+,\d+x", r"a++b", r"\s*=", r"\([^)]*\)\s*$", r"(\w+)=", r"(?:[ ]*- .*\n?)+$"])
def test_a_pattern_that_explodes_is_found_out(pattern):
    assert worse_than_linear(Used(re.compile(pattern), False)) is not None


@pytest.mark.parametrize("pattern", [r"(?<!a)a++b", r"(?<!\d)\d++,(?<!\d)\d++x", r"(?<!\s)\s*+=", r"\b(\w++)="])
def test_a_pattern_in_proportion_is_not(pattern):
    assert worse_than_linear(Used(re.compile(pattern), False)) is None


@pytest.mark.broad
def test_every_pattern_takes_a_time_in_proportion_to_the_text():
    found = patterns()
    assert len(found) > 50
    slow = {where: text for where, used in found.items() if (text := worse_than_linear(used)) is not None}
    assert not slow


@pytest.mark.parametrize(
    "line", [f"acc: {'2' * 150},{'2' * 150},{'2' * 150}x", f"acc: {'7' * 16_000}x", "acc" + " " * 16_000, ":" + "\t" * 16_000]
)
def test_a_log_with_a_long_torn_line_is_imported_at_once(run, tmp_path, line):
    log = tmp_path / "log.txt"
    log.write_text("acc: 1, 2, 3, gyro: 4, 5, 6\n" * 400 + line + "\n")
    code, _, err = run("import", log, "--odr", "100", "--gyro-unit", "dps", "--accel-unit", "g", "--out", tmp_path / "s")
    assert code in (0, 2), err
