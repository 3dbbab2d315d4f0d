"""The firmware of the repository, unmodified, on the emulated STM32F405: what it sends is what it sends under QEMU, bit for bit."""

from __future__ import annotations

import sys

import pytest
from conftest import ROOT
from exported_models import MODELS
from f405_programs import tools_missing

from session.bench.decoder import StreamDecoder
from session.bench.events import SampleChunk
from tinygc.deploy.embedded.program import Registers, program
from tinygc.deploy.embedded.source import source_files

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

sys.path.insert(0, str(ROOT / "firmware"))
import measure

from tinygc.annexes.emulated.machine import Machine

pytestmark = pytest.mark.emulation

SENSOR = Registers()


@pytest.fixture(scope="module")
def elf(tmp_path_factory):
    folder = tmp_path_factory.mktemp("firmware")
    for file, text in source_files(program(MODELS["tinygc_denoised"]), SENSOR, "A test.", {}).items():
        (folder / file).write_text(text)
    return measure.build("tinygc.elf", folder, folder / "build", SERIAL="4711")


def test_its_samples_are_those_that_qemu_sends(elf):
    """The same stamps and registers, sample by sample, though one runs on its own clock and the other on this machine's."""
    if trouble := measure.tools_missing():
        pytest.skip(trouble)
    pytest.importorskip("termios", reason="needs a pseudo-terminal, which only POSIX has")
    import contextlib
    import os

    from processes import PATIENCE_S, started, until

    machine = Machine(elf)
    machine.run_until(5.0)
    here = by_stamp(StreamDecoder().feed(machine.usart1.take()))
    decoder, there = StreamDecoder(), {}
    with contextlib.ExitStack() as running:
        start = lambda command, **how: running.enter_context(started(command, limit_s=PATIENCE_S, **how))  # noqa: E731
        emulator = running.enter_context(measure.Emulator(elf, start))
        port = os.open(emulator.ports[0], os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        running.callback(os.close, port)

        def poll():
            with contextlib.suppress(BlockingIOError):
                there.update(by_stamp(decoder.feed(os.read(port, 4096))))

        until(lambda: len(there) > 200, poll, "200 samples")
    both = sorted(here.keys() & there.keys())
    assert len(both) > 100
    assert all(here[stamp] == there[stamp] for stamp in both)


def by_stamp(chunks) -> dict[int, tuple]:
    rows = ((chunk.t_us.tolist(), chunk.registers.tolist()) for chunk in chunks if isinstance(chunk, SampleChunk))
    return {t_us: tuple(row) for stamps, table in rows for t_us, row in zip(stamps, table, strict=True)}
