"""A session folder from a raw file: the logs that a recording made, or would have made, from the same bytes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError, FormatError
from session.base.files import MB, copy_new, folder_whole, open_file, require_empty
from session.base.questions import QuestionsError
from session.bench.decoder import StreamDecoder
from session.bench.frames import damaged_words
from session.bench.logwriter import LogWriter
from session.bench.rawfile import cut_words
from session.bench.recorder import BLOCK, stream
from session.bench.session_file import ASSUMED, NAME, PATIENCE_S, SessionFile
from session.log.config import read_config
from session.log.logfile import read_log
from session.log.reader import Reader
from session.replay.convert import Imported, first_look_at, next_steps
from session.replay.dialects import OWN
from session.replay.interpretation import port_interpretation
from session.replay.options import Answers
from session.replay.sources import head_of
from session.replay.tables import TableReader

SUFFIX = ".bin"
#: bytes without a sample: three hours of a port that listens at a wrong speed
MOST_SILENT = 128 * MB


#: what no line of text holds
NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")


def is_raw(path: Path, answers: Answers) -> bool:
    """Whether a file is what a port gave, rather than a log: it is named so, and its bytes are no table of another program's.

    A board's own lines are a port's bytes as well.
    """
    if path.suffix.lower() != SUFFIX or not path.is_file():
        return path.suffix.lower() == SUFFIX
    head = head_of(path)
    if b"\n" not in head or NO_TEXT.search(head):
        return True
    try:
        return TableReader(path, answers).layout.dialect == OWN
    except QuestionsError:
        return False
    except FormatError:
        return True


def convert_raw(raw_path: Path, out: Path, answers: Answers, header: str | None = None) -> Imported:
    """Make a session folder of a raw file; session.toml is the one in its folder, or is made from the board's data and the answers.

    Nothing is left behind where it fails.  Raises FormatError and StorageError.
    """
    require_empty(out, "exists; give --out a new folder")
    open_file(raw_path).close()  # before anything is made
    decoder = StreamDecoder(header)
    with folder_whole(out) as work:
        logs = LogWriter(work)
        silent, samples = 0, 0
        for _ in stream(raw_path, decoder, logs):
            silent, samples = silent + 1 if decoder.samples == samples else 0, decoder.samples
            if silent * BLOCK > MOST_SILENT:
                raise FormatError(f"{raw_path}: no sample among {MOST_SILENT} bytes, behind {samples} samples; cut the file there")
        logs.write(decoder.finish())
        logs.close()
        if not logs.paths:
            raise FormatError(
                f"{raw_path}: no samples among {raw_path.stat().st_size} bytes ({decoder.garbage} are neither frame nor line); "
                "text in physical units that does not hold its header needs --header t_us,gx_dps,…"
            )
        assumed = _configure(raw_path, work, decoder, logs, answers)
    notes = [f"{path.name} written" for path in logs.paths[1:]]
    counts = {
        "samples lost": decoder.lost,
        "frames with a bad CRC": decoder.crc_errors,
        "bytes of garbage": decoder.garbage,
        "samples left out as implausible": decoder.implausible,
        "resets": decoder.resets,
    }
    notes += [f"{count} {what}" for what, count in counts.items() if count]
    if decoder.crc_errors:
        notes.append(f"of {decoder.crc_errors} damaged frames {damaged_words(decoder.crc_errors)}")
    notes += [words] if (words := cut_words(raw_path)) else []
    notes += [ASSUMED] * assumed
    log = out / logs.paths[0].name
    findings, turns, stills = first_look_at(out)
    steps, took = next_steps(out, findings), _took(raw_path, log)
    return Imported(out, log, ("a port's raw bytes",), decoder.samples, tuple(notes), findings, steps, took, "", turns, stills)


def _took(raw_path: Path, log: Path) -> tuple[str, ...]:
    """What the bytes were taken for, by the first log that was made of them; nothing where that cannot be read, which is a finding."""
    try:
        sensor = read_config(log.with_name(NAME)).sensor
        samples = read_log(log, sensor).samples
        layout = Reader(log).layout
    except CalibrationError:
        return ()
    rate = f"{samples.pace.rate_hz:.4g} Hz for {samples.duration_s:.1f} s" if np.diff(samples.t_ns).any() else "one sample"
    return port_interpretation(raw_path.name, layout, sensor, rate)


def _configure(raw_path: Path, out: Path, decoder: StreamDecoder, logs: LogWriter, answers: Answers) -> bool:
    """Write session.toml; whether its sensor is only assumed."""
    config = raw_path.with_name(NAME)
    if config.exists():
        copy_new(config, out / NAME)
        return False
    rate_hz = answers.odr_hz or (None if decoder.info else decoder.measured_odr_hz)
    file = SessionFile(out, None, rate_hz, answers.gyro_fs_dps, answers.accel_fs_g, answers.sensor)
    if file.configure(decoder.info, PATIENCE_S, bool(logs.physical), logs.board) is None:
        raise FormatError(
            f"{raw_path}: the board does not state its ranges, and no {NAME} lies in its folder; give --gyro-fs DPS --accel-fs G"
        )
    return file.assumed
