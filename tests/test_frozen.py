"""``benchmarks/frozen.py`` notices a changed number, a key that is gone and a changed word, and overlooks what differs from run to run."""

import json

import pytest

from benchmarks.frozen import compare


@pytest.fixture
def folders(tmp_path):
    """Two folders of the same files, and a function that compares them."""
    sides = [tmp_path / side for side in ("before", "after")]
    for side in sides:
        side.mkdir()
        (side / "fit_out.json").write_text(
            json.dumps({"tilt_deg": 0.0143, "versions": {"numpy": "2"}, "methods": {"pso": {"seconds": 0.25}}})
        )
        (side / "screen.txt").write_text(f"tilt 0.0143 deg\nPSO 12 0.25\n{side}/calibrate.py\n2026-11-28\n")
    return sides, lambda: compare(*sides, tuple(sides))


def test_a_number_counts_as_changed_from_one_in_a_billion_on(folders):
    (_, after), compared = folders
    file = after / "fit_out.json"
    file.write_text(file.read_text().replace("0.0143", repr(0.0143 * (1 + 5e-10))))
    assert compared().changed == []
    file.write_text(file.read_text().replace(repr(0.0143 * (1 + 5e-10)), repr(0.0143 * (1 + 2e-9))))
    assert len(compared().changed) == 1
    (after / "screen.txt").write_text((after / "screen.txt").read_text().replace("0.0143", "0.0144"))
    assert len(compared().changed) == 2
    for side, digits in zip(folders[0], ("24559653297,-0.111434886", "24559653298,-0.111434887"), strict=True):
        (side / "log.csv").write_text(f"{digits},0123abcdef\n")  # many digits are no hash
    assert len(compared().changed) == 3  # of the first, one in 10¹¹


def test_what_both_refuse_is_listed_since_nothing_of_it_is_compared(folders):
    for side in folders[0]:
        (side / "screen01_apply.txt").write_text("$ apply model.json log.csv\nexit code 2\ncalibrate: log.csv: cannot be read\n")
    assert folders[1]().refused == ["$ apply model.json log.csv"]
