"""What the firmware takes: the bound of its stack, beside what the emulated board uses of it, and the longest pass of its loop."""

from __future__ import annotations

import re
import sys

import pytest
from conftest import ROOT
from exported_models import MODELS
from processes import run

from session.bench import frames
from tinygc.annexes.emulated.cpu import missing
from tinygc.deploy.embedded.program import Registers, program
from tinygc.deploy.embedded.source import source_files

sys.path.insert(0, str(ROOT / "firmware"))
import measure
from misra_check import write_model
from stack import EXCEPTION_BYTES, StackError, sections, stack

pytestmark = [pytest.mark.emulation, pytest.mark.skipif(bool(measure.tools_missing()), reason=measure.tools_missing())]


@pytest.fixture(scope="module")
def recorder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorder")
    return measure.build("recorder.elf", folder, folder, ODR_HZ="1667", BAUD="2000000")


def test_the_recorders_stack_has_a_bound_that_the_board_comes_near_and_keeps(recorder):
    if trouble := missing():
        pytest.skip(trouble)
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import board_cost

    from tinygc.annexes.emulated.machine import Machine
    from tinygc.annexes.emulated.readings import AtRest, Fault
    from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort

    bound = stack(recorder)
    sensor = Asm330lhh(AtRest(), faults=[Fault("reset", 1.0), Fault("hang", 1.5, 0.05), Fault("parity", 1.7)])
    machine = Machine(recorder, SensorPort(sensor))
    board_cost.paint(machine, bound)
    machine.run_until(0.9)
    for number, command in enumerate(((frames.DATA_RATE, 6667.0), (frames.RANGES, 250, 2), (frames.SELF_TEST,), (frames.IDENTIFY,))):
        machine.usart1.feed(frames.encode_command(command[0], number, *command[1:]))
        machine.run_until(machine.clock.now_s() + 0.6)
    measured = board_cost.used(machine, bound)
    assert machine.resets == 0
    assert measured <= bound.main + bound.interrupt
    assert measured > 0.5 * bound.main
    assert bound.total < bound.reserved / 2
    assert bound.deepest[:2] == ("Reset_Handler", "main")


@pytest.mark.parametrize("name", ["tinygc_denoised", "all of it"])
def test_the_stack_with_a_model_fits(name, tmp_path):
    """Its self-test keeps a whole state there."""
    for file, text in source_files(program(MODELS[name]), Registers(), "A test.", {}).items():
        (tmp_path / file).write_text(text)
    elf = measure.build("tinygc.elf", tmp_path, tmp_path / "build")
    bound = stack(elf)
    assert "tinygc_self_test" in bound.deepest
    assert 1144 < bound.main < bound.total < bound.reserved == 4096
    measure.build("measure.elf", tmp_path, tmp_path / "build")  # whose main is another, in the same folder
    assert stack(elf) == bound


def test_the_page_states_what_the_firmware_takes(tmp_path):
    """Within 3 %: else run benchmarks/board_cost.py, and put its tables there."""
    page = (ROOT / "docs" / "firmware.md").read_text(encoding="utf-8")
    (tmp_path / "model").mkdir()
    write_model(tmp_path / "model")
    recorder = measure.build("recorder.elf", tmp_path, tmp_path, BAUD="2000000")
    modelled = measure.build("tinygc.elf", tmp_path / "model", tmp_path, BAUD="2000000")
    for name, elf in (("recorder", recorder), ("with the 195-parameter model", modelled)):
        (row,) = re.findall(rf"^\| {name} \| (.*) \|$", page, re.M)
        code, variables, main, interrupt, fault, total, _, reserved, *_ = (int(cell) for cell in row.split(" | "))
        size, bound = sections(elf), stack(elf)
        found = [size["code"], size["variables"], bound.main, bound.interrupt, bound.fault, bound.total, bound.reserved]
        assert [code, variables, main, interrupt, fault, total, reserved] == pytest.approx(found, rel=0.03), name


def test_the_loop_passes_each_millisecond_at_6667_hz(recorder):
    """Half a millisecond of work at most, a burst and a status among it; the watchdog could wait 300 times as long."""
    if trouble := missing():
        pytest.skip(trouble)
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import board_cost

    longest, reload_s, objections = board_cost.passes_of(recorder, board_cost.Situation("streams", lambda driven: driven.run(1.1)))
    assert 1000 < longest.instructions < 60_000
    assert longest.awake_s < 0.6e-3
    assert max(longest.lasted_s, reload_s) < 2e-3
    assert objections == []


LEAST = """
int main(void);
int work(int n);
void Reset_Handler(void) {{ main(); }}
__attribute__((interrupt)) void SysTick_Handler(void) {{ volatile char room[40]; room[0] = 1; }}
__attribute__((noinline)) static void on_fault(void) {{ volatile char room[8]; room[0] = 1; }}
void HardFault_Handler(void) {{ on_fault(); }}
{body}
int main(void) {{ return work(3) / work(4); }}
__attribute__((section(".vectors"), used)) static void (*const VECTORS[98])(void) = {{0, Reset_Handler}};
"""


def built(body: str, folder):
    source = folder / "fault.c"
    source.write_text(LEAST.format(body=body))
    flags = ["-mcpu=cortex-m4", "-mthumb", "-O1", "-fcallgraph-info=su", "-nostartfiles", "--specs=nano.specs", "-ffunction-sections"]
    run(["arm-none-eabi-gcc", *flags, "-c", source, "-o", folder / "fault.o"], check=True)
    elf, script = folder / "x.elf", ROOT / "firmware" / "stm32f405.ld"
    linking = [*flags[:2], *flags[4:6], "-T", script, f"-Wl,-Map={folder / 'x.map'}"]
    run(["arm-none-eabi-gcc", *linking, folder / "fault.o", "-o", elf], check=True)
    return stack(elf)


@pytest.mark.parametrize(
    ("body", "most"),
    [
        ("__attribute__((noinline)) int work(int n) { volatile char room[500]; room[0] = (char)n; return room[0]; }", 540),
        ("int deep(int n) { volatile char room[700]; room[0] = (char)n; return room[0]; }\nint (*volatile way)(int) = deep;\n"
         "__attribute__((noinline)) int work(int n) { return way(n) + 1; }", 740),
    ],
)  # fmt: skip
def test_frames_add_up_through_calls_and_pointers(body, most, tmp_path):
    found = built(body, tmp_path)
    assert most - 50 < found.main < most + 30
    assert EXCEPTION_BYTES + 40 <= found.interrupt < EXCEPTION_BYTES + 80
    assert found.reserved == 4096


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("int other(int n);\n__attribute__((noinline)) int work(int n) { return n ? other(n - 1) + n : 0; }\n"
         "__attribute__((noinline)) int other(int n) { volatile int k = n; return work(k) * 3; }",
         "recursion: work calls other calls work"),
        ("__attribute__((noinline)) int work(int n) { volatile char *room = __builtin_alloca(n); room[0] = 1; return room[n - 1]; }",
         "the frame of work has no bound"),
    ],
)  # fmt: skip
def test_what_has_no_bound_is_refused(body, said, tmp_path):
    with pytest.raises(StackError, match=said):
        built(body, tmp_path)
