"""One clear line and exit code 2 for options that are none, or that no sensor has."""

from pathlib import Path

import pytest
from commandline import refused

from tinygc.cli import arguments as arguments_of


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--odr-hz", 200),
        ("--latitude-deg", 95),
        ("--gyro-fs-dps", 300),
        ("--segments", 0),
        ("--closure", 3),
        ("--segments", 2001),
        ("--closure", 1e9),
        ("--still-s", 1e6),
        ("--gyro-noise-dps-rthz", "inf"),
        ("--accel-noise-ug-rthz", "nan"),
        ("--gyro-bias-dps", "inf"),
        ("--temperature-start-c", "nan"),
        ("--heading-deg", "inf"),
        ("--vigour", "inf"),
    ],
)
def test_simulate_refuses_what_no_sensor_or_bench_has(run, tmp_path, option, value):
    refused(run("simulate", "--out", tmp_path / "s", option, value))
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ("fly",),
        ("fit",),
        ("fit", "x", "--methods", "magic"),
        ("fit", "x", "--methods", ","),
        ("fit", "x", "--folds", "1"),
        ("fit", "x", "--seed", "-1"),
        ("fit", "x", "--limit", "0"),
        ("fit", "x", "--limit", "nan"),
        *(("board", flag, bad) for flag in ("--rate", "--lead", "--tail", "--uptime", "--closure") for bad in ("nan", "inf", "-1")),
        ("board", "--uptime", "1e300"),
        ("simulate",),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(run, arguments):
    refused(run(*arguments), "; see --help")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("chek", "x"), "'chek' is no command; is 'check' meant?"),
        (("aply", "x"), "is 'apply' meant?"),
        (("fit", "x", "--limmit", "0.1"), "fit has no option --limmit; is '--limit' meant?"),
        (("apply", "m.json", "log.csv", "--uot", "x.csv"), "apply has no option --uot; is '--out' meant?"),
        (("export", "x", "--to", "kaliber"), "argument --to: 'kaliber' is no choice, expected json, kalibr,"),
        (("export", "x", "--to", "kaliber"), "is 'kalibr' meant?"),
        (("fit", "x", "--methods", "least-squares"), "is 'least_squares' meant?"),
        (("fit", "x", "--bias", "still"), "is 'stills' meant?"),
        (("zzz",), "'zzz' is no command, expected demo, sensors, ports"),
    ],
)
def test_a_wrong_word_is_answered_with_the_nearest(run, arguments, words):
    refused(run(*arguments), words, "; see --help")


@pytest.mark.parametrize(
    ("text", "name"), [("ros2", "ros"), ("x-io", "xio"), ("X_IO", "xio"), ("Fusion", "xio"), ("PX4", "px4"), ("C99", "c")]
)
def test_formats_are_understood_in_other_spellings(text, name):
    assert arguments_of.parser(["export"]).parse_args(["export", "x", "--to", text]).to == name


@pytest.mark.parametrize(
    ("arguments", "expected"), [((), []), (("--exclude", "3,4"), [3, 4]), (("--exclude", "3", "--exclude=4, 5"), [3, 4, 5])]
)
def test_excluded_numbers_stand_with_commas_and_may_be_repeated(arguments, expected):
    args = arguments_of.parser().parse_args(["fit", *arguments, "folder"])
    assert (args.folder, args.exclude) == (Path("folder"), expected)


@pytest.mark.parametrize("text", ["", "3 4", "-1", "3,,4", "three", "1_0"])
def test_excluded_numbers_that_are_none_are_refused(run, text):
    refused(run("fit", "folder", f"--exclude={text}"), "--exclude", "no list of segment numbers")


def test_an_effect_without_its_parameters_is_said_with_what_is_expected(run, tmp_path):
    asked = "'gyro.thermal_bias' is an effect without its parameters; give ID=JSON such as 'gyro.thermal_bias={"
    refused(run("simulate", "--out", tmp_path / "s", "--effect", "gyro.thermal_bias"), asked)
