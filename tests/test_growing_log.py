"""A log that has been written is not written again: it only grows, and what somebody changed in it is kept."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from streams import frame_list, sent

from session.bench.decoder import StreamDecoder
from session.bench.events import SampleChunk, Trouble
from session.bench.logwriter import SHORT_STARTS, LogWriter
from session.bench.rawfile import GrowingFile
from session.bench.recorder import stream
from session.io.errors import FormatError

TEXT = "".join(f"{i},a line of it\n" for i in range(2000))


def written(path: Path, text: str, portions=(1, 50, 10_000)) -> GrowingFile:
    file, start, k = GrowingFile(path), 0, 0
    while start < len(text):
        file.write(text[start : start + portions[k % len(portions)]])
        file.flush()
        start, k = start + portions[k % len(portions)], k + 1
    file.close()
    return file


@pytest.mark.parametrize("there", [0, 1, 51, 20_000, len(TEXT) - 1])
def test_it_goes_on_where_it_ended(tmp_path, there):
    path = tmp_path / "log0001.csv"
    path.write_text(TEXT[:there])
    assert written(path, TEXT).aside is None
    assert path.read_text() == TEXT
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_whole_is_not_touched(tmp_path):
    path = tmp_path / "log0001.csv"
    path.write_text(TEXT)
    path.chmod(0o644)
    os.utime(path, ns=(1, 1))
    written(path, TEXT)
    written(path, TEXT[:100])  # shorter: what is there stays
    assert path.read_text() == TEXT
    assert path.stat().st_mtime_ns == 1


@pytest.mark.parametrize("at", [0, 30, 20_000, len(TEXT) - 2])
def test_what_somebody_changed_is_kept_beside_it(tmp_path, at):
    path, changed = tmp_path / "log0001.csv", TEXT[:at] + "#" + TEXT[at + 1 :]
    for number in (1, 2):
        path.write_text(changed)
        file = written(path, TEXT)
        assert path.read_text() == TEXT
        assert file.aside == tmp_path / f"log0001.csv.changed{number}"
        assert file.aside.read_text() == changed


def test_the_logs_of_a_recording_grow_when_it_is_played_again(tmp_path):
    """Whatever was cut off: as after a kill."""
    rng = np.random.default_rng(0)
    (tmp_path / "raw.bin").write_bytes(b"".join(frame_list(*sent(3000))))
    for _ in range(5):
        play(tmp_path)
        log = tmp_path / "log0001.csv"
        whole = log.read_bytes()
        assert whole.count(b"\n") == 3001
        log.write_bytes(whole[: rng.integers(len(whole))])
    logs = play(tmp_path)
    assert log.read_bytes() == whole
    assert logs.put_aside == []
    log.write_bytes(whole.replace(b",", b";", 1))
    assert play(tmp_path).put_aside == [tmp_path / "log0001.csv.changed1"]
    assert log.read_bytes() == whole
    (tmp_path / "log0001.csv.gz").write_bytes(gzip.compress(whole))
    log.unlink()
    with pytest.raises(FormatError, match="gunzip"):
        play(tmp_path)


def play(folder: Path) -> LogWriter:
    decoder, logs = StreamDecoder(), LogWriter(folder)
    for _ in stream(folder / "raw.bin", decoder, logs):
        pass
    logs.write(decoder.finish())
    logs.close()
    return logs


def flickering(starts: int, samples: int) -> list:
    """Events of a board that begins anew again and again."""
    events = []
    for k in range(starts):
        events += [Trouble("reset")] * (k > 0) + [SampleChunk(*sent(samples, 1000 * k, seed=k))]
    return events


def test_a_board_that_resets_every_few_frames_does_not_fill_the_folder(tmp_path):
    """Behind twenty such starts one gets a log only where it lasts a second; what got none is counted."""
    logs = LogWriter(tmp_path)
    logs.write(flickering(3000, 100))
    assert len(list(tmp_path.glob("log*.csv"))) == SHORT_STARTS
    logs.write([Trouble("reset"), SampleChunk(*sent(1000, 7)), SampleChunk(*sent(2000, 700_000))])  # 0.6 s, then more than a second
    logs.write([Trouble("reset"), SampleChunk(*sent(50, 7))])  # a good one has been: this counts again
    logs.close()
    lengths = [path.read_text().count("\n") - 1 for path in logs.paths]
    assert lengths == [100] * SHORT_STARTS + [3000, 50]
    assert (logs.not_logged, logs.not_logged_starts) == (2980 * 100, 2980)


def test_how_the_events_are_cut_does_not_matter_to_the_logs(tmp_path):
    events = [*flickering(40, 30), SampleChunk(*sent(2000, 100_000_000)), Trouble("implausible", 1, 5), Trouble("implausible", 2, 5)]
    made = []
    for name, size in (("whole", len(events)), ("singly", 1)):
        (tmp_path / name).mkdir()
        logs = LogWriter(tmp_path / name)
        for start in range(0, len(events), size):
            logs.write(events[start : start + size])
            logs.flush()
        logs.close()
        made.append([path.read_text() for path in logs.paths])
    assert made[0] == made[1]
    assert made[0][-1].count("left out as implausible: 3 (t_us 5)") == 1
