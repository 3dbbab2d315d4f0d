"""What ``view`` shows: curves that lose no peak, stills, segments and closure as the fit has them, and what is changed by hand."""

import errno
import json
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import writable_copy
from processes import until

from calibrate import main
from session.base.units import DEG, STANDARD_GRAVITY_MPS2
from session.bench.page.server import PageServer
from session.log.folder import read_session
from tinygc.cli.arguments import _is_result
from tinygc.cli.commands.view import Viewer
from tinygc.closure.residual import closure_angles
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.models.linear import bias_only
from tinygc.reporting.view.content import Closure, Recording, fitted
from tinygc.reporting.view.curves import Curves
from tinygc.reporting.view.page import whole_page

SESSION = Path(__file__).resolve().parent.parent / "data" / "session1"


@pytest.fixture(scope="module")
def recording():
    return Recording(read_session(SESSION))


@pytest.fixture(scope="module")
def closure(recording):
    return Closure.of(recording.session)


@pytest.mark.parametrize("count", [7, 300, 5000, 10**6])
def test_curves_hold_every_peak_of_the_span_that_is_asked_for(recording, count):
    samples, curves = recording.session.logs[0].samples, Curves(recording.session.logs)
    (piece,) = curves.between(20.0, 60.0, count)
    t_s = (samples.t_ns - samples.t_ns[0]) * 1e-9
    inside = (t_s >= 20.0) & (t_s <= 60.0)
    values = np.hstack([samples.gyro[:] / DEG, samples.accel[:] / STANDARD_GRAVITY_MPS2, samples.temp_c[:][:, None]])[inside]
    low, high = np.array(piece["low"]), np.array(piece.get("high", piece["low"]))
    assert len(piece["t"]) <= min(1.1 * count, inside.sum()) + 2
    assert (low.min(axis=1) <= values.min(axis=0) + 1e-3).all()
    assert (high.max(axis=1) >= values.max(axis=0) - 1e-3).all()
    assert piece["t"][0] <= 20.0
    if count == 10**6:  # single samples
        assert "high" not in piece
        np.testing.assert_allclose(low[:, 1:-1].T, values, atol=6e-4)


def test_a_session_of_two_logs_lies_end_to_end(recording):
    log = recording.session.logs[0]
    curves = Curves([log, log])
    first, second = curves.between(0.0, curves.began_s[-1], 100)
    np.testing.assert_allclose(curves.began_s, [0.0, log.samples.duration_s, 2 * log.samples.duration_s])
    assert second["low"] == first["low"]
    np.testing.assert_allclose(np.array(second["t"]) - first["t"], log.samples.duration_s, atol=2e-6)
    assert [len(curves.between(1.0, 2.0, 100)), curves.between(-5.0, -1.0, 100)] == [1, []]


def test_stills_segments_and_errors_are_those_of_the_fit(recording, closure):
    content, problem = recording.content(closure), fit_session(SESSION, FitOptions(methods=("least_squares",))).problem
    assert [s["number"] for s in content["segments"]] == [s.number for s in problem.segments]
    np.testing.assert_allclose([s["from_s"] for s in content["segments"]], [s.start_s for s in problem.segments], atol=1e-6)
    np.testing.assert_allclose([s["from_s"] for s in content["stills"]], [s.start_s for s in problem.stills], atol=1e-6)
    raw = np.linalg.norm(closure_angles(problem.batch, bias_only())[:, :2], axis=1) / DEG
    np.testing.assert_allclose([s["raw_deg"] for s in content["segments"]], raw)
    after = np.array([s["after_deg"] for s in content["segments"]])
    assert content["closure"]["after_deg"] == pytest.approx(np.sqrt(np.mean(after**2)))
    assert content["closure"]["floor_deg"] == pytest.approx(problem.floor.tilt_rms / DEG)


def test_what_cannot_be_fitted_is_shown_with_the_reason(recording):
    content = recording.content(None, why="7 usable segments <b>")
    assert content["why"] == "7 usable segments <b>"
    assert {each["after_deg"] for each in content["segments"]} == {None}
    page = whole_page(content, [])
    assert "<b>" not in page.split("</style>")[1].split('id="data">')[1].split("</script>")[0]


def test_out_writes_one_file_that_loads_nothing(tmp_path, capsys):
    (tmp_path / "view.html").write_text("<!DOCTYPE html>\n<title>TinyGC: of an earlier time</title>", encoding="utf-8")
    assert main(["view", str(SESSION), "--out", str(tmp_path / "view.html")]) == 0
    assert _is_result(tmp_path / "view.html")  # and it may be written again
    assert capsys.readouterr().out == f"written: {tmp_path / 'view.html'}\n"
    page = (tmp_path / "view.html").read_text(encoding="utf-8")
    assert not re.search(r"""(src|href)=["']?(?!data:)""", page.split("<script")[0])
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S)[1])
    assert len(data["content"]["segments"]) == 40
    assert [log["name"] for log in data["content"]["logs"]] == ["log0001.csv.gz", "closure0001.csv.gz"]
    assert len(data["curves"]) == 2


# Changes by hand, as the page asks for them.


@pytest.fixture
def viewer(tmp_path):
    folder = writable_copy(SESSION, tmp_path / "s")
    server = PageServer()
    yield Viewer(Recording(read_session(folder)), server)
    server.server_close()


def wish(viewer, **fields):
    return viewer.hear(json.dumps(fields).encode())


def shown(viewer):
    return json.loads(viewer.answer("content"))


def test_a_change_is_kept_and_undone_to_the_same_file(viewer):
    before = viewer.toml.read_bytes()
    for _ in range(2):  # by two windows at once
        assert wish(viewer, do="leave out", kind="segment", number=6) == 200
    assert viewer.toml.read_text(encoding="utf-8").count("[[exclude]]") == 1
    assert [s["number"] for s in shown(viewer)["segments"] if s["by_hand"]] == [6]
    assert shown(viewer)["stale"]
    assert wish(viewer, do="leave out", kind="still", number=20) == 200
    assert [s["number"] for s in shown(viewer)["stills"] if s["by_hand"] == "left out"] == [20]
    assert len(shown(viewer)["segments"]) == 39
    assert wish(viewer, do="take back", kind="still", number=20) == 200
    assert wish(viewer, do="take back", kind="segment", number=6) == 200
    assert viewer.toml.read_bytes() == before


def test_moved_ends_are_kept_and_moved_again(viewer):
    found = shown(viewer)["stills"][9]
    for shift in (0.3, 0.5):
        ends = [found["from_s"] + shift, found["to_s"]]
        assert wish(viewer, do="move", kind="still", number=9, ends=ends) == 200
        now = shown(viewer)["stills"][9]
        np.testing.assert_allclose([now["from_s"], now["to_s"]], ends, atol=0.006)
        assert now["by_hand"] == "moved"
    assert viewer.toml.read_text(encoding="utf-8").count("[[still]]") == 1
    assert wish(viewer, do="take back", kind="still", number=9) == 200
    assert shown(viewer)["stills"][9] == found


@pytest.mark.parametrize(
    ("asked", "status", "says"),
    [
        ({"do": "move", "kind": "still", "number": 9, "ends": [47.0, 47.01]}, 409, "shorter than 0.1 s"),
        ({"do": "move", "kind": "still", "number": 9, "ends": [47.7, 55.0]}, 409, "two stills overlap"),
        ({"do": "move", "kind": "still", "number": 0, "ends": [-3.0, 2.0]}, 409, "outside of the log"),
        ({"do": "leave out", "kind": "segment", "number": 400}, 400, ""),
        ({"do": "move", "kind": "still", "number": 9, "ends": ["a", None]}, 400, ""),
        ({"do": "leave out"}, 400, ""),
        ({"do": "leave out", "kind": "segment", "number": float("inf")}, 400, ""),
        ({"do": "leave out", "kind": "still", "number": -1}, 400, ""),
        ({"do": "move", "kind": "still", "number": 9, "ends": [float("nan"), 50.0]}, 400, ""),
        ([], 400, ""),
    ],
)
def test_a_change_that_cannot_be_changes_nothing(viewer, asked, status, says):
    before = viewer.toml.read_bytes()
    assert viewer.hear(json.dumps(asked).encode()) == status
    assert says in viewer._refused
    assert viewer.toml.read_bytes() == before
    assert not shown(viewer)["stale"]


def test_a_full_disk_leaves_the_file_as_it_is(viewer, monkeypatch):
    assert wish(viewer, do="leave out", kind="still", number=9) == 200
    before = viewer.toml.read_bytes()

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    assert wish(viewer, do="leave out", kind="segment", number=3) == 409
    assert viewer._refused.startswith("No space left on device")
    assert viewer.toml.read_bytes() == before


def test_a_fit_that_fails_is_stated_and_the_page_goes_on(viewer, monkeypatch):
    works, given = fitted, iter([lambda *_: 1 / 0])
    monkeypatch.setattr("tinygc.reporting.view.content.fitted", lambda *each: next(given, works)(*each))
    viewer.start()
    until(lambda: not viewer._doing)
    assert "ZeroDivisionError" in shown(viewer)["why"]
    assert wish(viewer, do="refit") == 200
    until(lambda: not viewer._doing)
    assert shown(viewer)["closure"]["turns"] == 40


@pytest.mark.parametrize("name", ["", "curves/1", "curves/a/b/c", "curves/nan/1/5", "content/1", "../session.toml"])
def test_other_names_are_not_known(viewer, name):
    assert viewer.answer(name) is None


def test_segments_that_a_reference_cuts_are_not_left_out_here(viewer):
    class Reference:
        title = "truth file"

    session = viewer.recording.session
    object.__setattr__(session, "reference", Reference())
    assert wish(viewer, do="leave out", kind="segment", number=6) == 409
    assert viewer._refused == "truth files cut these segments; leave one out with fit --exclude 6"
