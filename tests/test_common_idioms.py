"""What many modules need stands once: edges of runs, a scatter from medians, where logs begin, units, and where parameters stand."""

import re
from pathlib import Path

import numpy as np
import pytest

from session.io.numeric import runs_of, sigma_of, sigma_of_steps
from session.io.reader import fresh
from session.io.samples import Samples, start_times
from session.io.units import NS, NS_PER_S

ROOT = Path(__file__).resolve().parent.parent
SOURCES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for p in ("session", "tinygc") for path in (ROOT / p).rglob("*.py")
}


@pytest.mark.parametrize(
    ("mask", "runs"),
    [("", []), ("000", []), ("111", [(0, 3)]), ("1", [(0, 1)]), ("0110", [(1, 3)]), ("1011001", [(0, 1), (2, 4), (6, 7)])],
)
def test_runs(mask, runs):
    assert list(zip(*(edges.tolist() for edges in runs_of(np.array([c == "1" for c in mask], dtype=bool))), strict=True)) == runs


def test_scatter_is_that_of_the_noise_and_wild_values_do_not_move_it():
    rng = np.random.default_rng(0)
    noise = rng.normal(0, [1.0, 2.0, 3.0], (40_000, 3))
    noise[::50] = 1e6
    assert sigma_of(noise) == pytest.approx([1, 2, 3], rel=0.04)
    assert sigma_of(noise[:, 0], axis=None) == sigma_of(noise)[0]
    ramp = np.linspace(0, 100, 40_000)[:, None]
    assert sigma_of_steps(ramp + rng.normal(0, [1.0, 2.0, 3.0], (40_000, 3))) == pytest.approx([1, 2, 3], rel=0.03)


def test_logs_lie_one_after_the_other():
    logs = [Samples(np.array(t) * NS_PER_S, np.zeros((2, 3)), np.zeros((2, 3))) for t in ([5, 7], [100, 103], [0, 4])]
    assert start_times(logs).tolist() == [0, 2, 5, 9]
    assert start_times([]).tolist() == [0]


def test_a_stamp_is_fresh_if_it_is_later():
    assert fresh(np.array([3, 3, 4, 4, 4, 9])).tolist() == [True, False, True, False, False, True]
    assert fresh(np.zeros(0, dtype=np.int64)).tolist() == []


@pytest.mark.parametrize(
    ("idiom", "home"),
    [
        (r"0\.6745|1\.4826", "session/io/numeric.py"),
        (r"flatnonzero\(np\.diff\(np\.concatenate", "session/io/numeric.py"),
        (r"cumsum\(\[0", "session/io/samples.py"),
        (r"= 1e-9  #: s per", "session/io/units.py"),
        (r"slice\(0, 9\), slice\(9, 12\)", "tinygc/models/linear.py"),
        (r"FIRST_CLAIM = ", "tinygc/noise/twin.py"),
    ],
)
def test_each_has_one_home(idiom, home):
    assert [name for name, text in SOURCES.items() if re.search(idiom, text)] == [home]


def test_no_module_writes_nanoseconds_out():
    """Stamps become seconds by ``NS``, and seconds stamps by ``NS_PER_S``."""
    assert NS * NS_PER_S == 1
    written = re.compile(r"_ns\b.*\* ?1e-9|ticks \* 1e-9|\b1e9 /|(_s|rows\]) \* 1e9")
    assert [(name, line) for name, text in SOURCES.items() for line in text.splitlines() if written.search(line)] == []


#: an index into the linear model's vector, or into the twin's state, written out: 9 of E, 3 of B, 2 of the Earth, gravity, claims
WRITTEN_OUT = re.compile(
    r"\[([^\[\]]*, )?(:9|9:|9:12|:12|12:|12:14|12:15|:14|14|:15|15:)(, [^\[\]]*)?\]"
    r"|\b(9|12|15) \+ (axis|sum\()|, at\b.* = .*\b1[25]\b|\bat\b.* = 1[25]\b"
)


@pytest.mark.parametrize(
    "line",
    [
        "at = 15 + sum(sizes)",
        "at, claims = 15, []",
        "rows, at = list(range(12)), 15",
        "vector[:9].reshape(3, 3)",
        "slope[:, 9:12]",
        "design[..., 9:]",
        "covariance[:12, :12]",
        "float(vector[14])",
        "still[:, axis, 9 + axis] = 1.0",
    ],
)
def test_a_place_that_is_written_out_is_seen(line):
    assert WRITTEN_OUT.search(line)


def test_no_module_writes_out_where_a_parameter_stands():
    """``tinygc.models.linear`` names the places in the linear model's vector, ``tinygc.noise.twin`` those in the state's."""
    lines = [(name, line) for name, text in SOURCES.items() if name.startswith("tinygc/") for line in text.splitlines()]
    assert [(name, line) for name, line in lines if WRITTEN_OUT.search(line.replace("hexdigest()[:12]", ""))] == []
