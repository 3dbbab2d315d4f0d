"""What features write is whole, or is as it was, whichever call to the system fails; and it goes through no link."""

import numpy as np
import pytest
from failing_calls import KILLED, Writer, contents, tried
from feature import feature
from table_recordings import table_toml

from session.base.errors import StorageError

table_csv, verbs = feature("tinygc.features.tables.machines.angles"), feature("tinygc.features.tables.machines.verbs")
description, lines = feature("tinygc.features.tables.machines.description"), feature("tinygc.features.unit.watch.lines")


def table(folder):
    (folder / "table.toml").write_text(table_toml("middle", "inner"))


def angles(*logs):
    def write(folder):
        file = table_csv.AngleFile(folder / "table.csv", description.read_description(folder / "table.toml"))
        for log in logs:
            file.add(log, 1000, verbs.Where(np.array([0.1, 0.2]), False))
        file.close()

    return write


def begun(folder):
    table(folder)
    angles("log0001.csv")(folder)


def watched(folder):
    written = lines.JsonLines(folder / "watch.jsonl", lambda said: None)
    for number in range(3):
        written.write({"schema": "tinygc-watch/1", "number": number})
    written.end()


WRITERS = {
    "table.csv": Writer(angles("log0001.csv", "log0002.csv"), table, grows=True),
    "table.csv that goes on": Writer(angles("log0002.csv"), begun, grows=True),
    "watch.jsonl": Writer(watched, grows=True),
}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")  # the killed close nothing
@pytest.mark.parametrize("name", WRITERS)
def test_whichever_call_fails_the_old_is_whole_or_the_new_and_nothing_goes_through_a_link(tmp_path, name):
    for fault in ("ENOSPC", KILLED):
        (tmp_path / fault).mkdir()
        count, wrong = tried(WRITERS[name], tmp_path / fault / "w", fault, lambda number: True)
        assert (wrong, count > 3) == ([], True)
    (tmp_path / "w").mkdir()
    WRITERS[name].before(tmp_path / "w")
    path, victim = tmp_path / "w" / name.split()[0], tmp_path / "victim"
    victim.write_bytes(path.read_bytes() if path.exists() else b"")
    path.unlink(missing_ok=True)
    path.symlink_to(victim)
    before = contents(tmp_path)
    with pytest.raises(StorageError, match=f"{path.name}: is a link to .*remove it"):
        WRITERS[name].write(tmp_path / "w")
    assert contents(tmp_path) == before
