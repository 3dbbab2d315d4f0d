"""table.csv is whole, or is as it was, whichever call to the system fails; and it goes through no link."""

import numpy as np
import pytest
from failing_calls import Writer, hold_whole
from table_recordings import table_toml

from tinygc.features.tables.machines import angles as table_csv
from tinygc.features.tables.machines.description import read_description
from tinygc.features.tables.machines.link import Where


def table(folder):
    (folder / "table.toml").write_text(table_toml("middle", "inner"))


def angles(*logs):
    def write(folder):
        file = table_csv.AngleFile(folder / "table.csv", read_description(folder / "table.toml"))
        for log in logs:
            file.add(log, 1000, Where(np.array([0.1, 0.2]), False))
        file.close()

    return write


def begun(folder):
    table(folder)
    angles("log0001.csv")(folder)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")  # the killed close nothing
@pytest.mark.parametrize(("logs", "before"), [(("log0001.csv", "log0002.csv"), table), (("log0002.csv",), begun)])
def test_whichever_call_fails_the_old_is_whole_or_the_new(tmp_path, logs, before):
    hold_whole(Writer(angles(*logs), before, grows=True), "table.csv", tmp_path)
