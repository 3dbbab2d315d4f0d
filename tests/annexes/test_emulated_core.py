"""The emulated STM32F405: instructions, time, exceptions, and the existing firmware on it."""

from __future__ import annotations

import numpy as np
import pytest
from f405_programs import came_to_its_end, compiled, found, tools_missing

from tinygc.annexes.emulated.cpu import RAM, ProgramError, segments

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from tinygc.annexes.emulated.machine import CYCLES_PER_INSTRUCTION, Machine

pytestmark = pytest.mark.emulation


def alone(text: str, folder, t_s: float = 0.05, **how) -> Machine:
    machine = Machine(compiled(text, folder), **how)
    machine.run_until(t_s)
    assert machine.bus.objections == {}
    assert came_to_its_end(machine)
    return machine


def test_time_is_instructions_times_the_factor(tmp_path):
    """A thousand additions between two readings of CYCCNT."""
    text = """
    int main(void)
    {
        cycles_on();
        const uint32_t a = CYCCNT;
        __asm volatile(".rept 1000\\n\\tadds r0, r0, #1\\n\\t.endr" ::: "r0", "cc");
        found[0] = CYCCNT - a;
        return 0;
    }"""
    for factor in (1.0, CYCLES_PER_INSTRUCTION, 2.0):
        assert found(alone(text, tmp_path, cycles_per_instruction=factor))[0] == pytest.approx(1001 * factor, abs=3 * factor)


def test_a_millisecond_is_one(tmp_path):
    """SysTick and CYCCNT agree, asleep and awake."""
    text = """
    int main(void)
    {
        cycles_on();
        systick(168000);
        while (milliseconds < 3) WFI();
        const uint32_t a = CYCCNT;
        while (milliseconds < 13) WFI();
        found[0] = CYCCNT - a;
        const uint32_t b = CYCCNT;
        while (milliseconds < 23) ;
        found[1] = CYCCNT - b;
        return 0;
    }"""
    machine = alone(text, tmp_path)
    np.testing.assert_allclose(found(machine, 2), 10 * 168000, atol=200)
    assert machine.load == pytest.approx(10 / 50, abs=0.01)


def test_a_wait_for_cycles_takes_its_time_and_few_turns(tmp_path):
    text = """
    int main(void)
    {
        cycles_on();
        systick(168000);
        const uint32_t a = CYCCNT;
        while (CYCCNT - a < 1680000) ;
        found[0] = milliseconds;
        return 0;
    }"""
    machine = alone(text, tmp_path)
    assert found(machine)[0] == 10
    assert machine.cpu.instructions < 200_000


def test_interrupts_disturb_no_computation(tmp_path):
    """Conditional blocks, flags, integer and floating-point registers, through thousands of interrupts that use them as well."""
    text = """
    volatile float f;
    void SysTick_Handler(void)
    {
        float x = f;
        for (int i = 0; i < 5; i++) x = x * 1.25f + (float)i;
        f = x > 1e6f ? 1.0f : x;
        milliseconds++;
    }
    volatile uint32_t seed = 1;
    static uint32_t work(void)
    {
        uint32_t a = seed, b = 0;
        float x = 0.5f, y = 1.5f;
        for (uint32_t i = 0; i < 200000; i++) {
            a = a * 1664525u + 1013904223u;
            if (a & 0x80) b ^= a; else b += i;
            x = x * 0.75f + y;
            y = (a & 0x100) ? y * 0.5f : y + 0.125f;
        }
        union { float f; uint32_t u; } xs = {x}, ys = {y};
        return b ^ xs.u ^ ys.u;
    }
    int main(void)
    {
        found[0] = work();
        systick(1499);
        found[1] = work();
        found[2] = milliseconds;
        REG(0xE000E010) = 0;
        return 0;
    }"""
    quiet, disturbed, interrupts = found(alone(text, tmp_path, 0.2), 3)
    assert quiet == disturbed
    assert interrupts > 2000


def test_the_more_urgent_interrupts_the_less(tmp_path):
    """SysTick at the lower priority pends EXTI4, which comes at once; PendSV, the least, waits for both; masked ones wait as well."""
    text = """
    static volatile uint32_t n;
    static void say(uint32_t what) { found[n++] = what; }
    static uint32_t psr(void) { uint32_t v; __asm volatile("mrs %0, ipsr" : "=r"(v)); return v; }
    void PendSV_Handler(void) { say(0x300 | psr()); }
    void EXTI4_Handler(void) { say(0x200 | psr()); }
    void SysTick_Handler(void)
    {
        REG(0xE000E010) = 0;
        REG(0xE000ED04) = 1u << 28;
        say(0x100 | psr());
        REG(0xE000E200) = 1u << 10;
        say(0x101);
    }
    int main(void)
    {
        irq(10);
        priority(10, 2);
        BYTE(0xE000ED23) = 5 << 4;
        BYTE(0xE000ED22) = 15 << 4;
        __asm volatile("cpsid i" ::: "memory");
        systick(1000);
        for (volatile int i = 0; i < 1000; i++) ;
        say(1);
        __asm volatile("cpsie i" ::: "memory");
        for (volatile int i = 0; i < 100; i++) ;
        say(2);
        return 0;
    }"""
    assert found(alone(text, tmp_path), 6) == [1, 0x10F, 0x21A, 0x101, 0x30E, 2]


def test_a_supervisor_call_and_the_stack_of_an_exception(tmp_path):
    """The handler finds its caller's registers on an aligned stack."""
    text = """
    void SVC_Handler(void)
    {
        __asm volatile("mov r1, sp\\n\\tldr r2, =found\\n\\tstr r1, [r2]\\n\\tldr r3, [r1]\\n\\tstr r3, [r2, #4]\\n\\tbx lr"
                       ::: "r1", "r2", "r3");
    }
    int main(void) { register uint32_t r0 __asm("r0") = 0xCAFE; __asm volatile("svc 0" : "+r"(r0)); found[2] = r0; return 0; }"""
    stack, first, after = found(alone(text, tmp_path), 3)
    assert stack % 8 == 0
    assert (first, after) == (0xCAFE, 0xCAFE)


def test_a_reset_that_is_asked_for_comes(tmp_path):
    text = "int main(void) { if (++found[0] < 3) REG(0xE000ED0C) = 0x05FA0004; return 0; }"
    machine = alone(text, tmp_path)
    assert machine.resets == 2


def test_an_instruction_can_be_watched(tmp_path):
    """Each of its runs, at its time, whatever runs between."""
    text = """
    __attribute__((noinline)) void work(void) { found[1]++; __asm volatile("" ::: "memory"); }
    int main(void) { found[0] = (uint32_t)work; systick(168000); while (milliseconds < 5) { work(); WFI(); } return 0; }"""
    elf = compiled(text, tmp_path)
    address = found(alone(text, tmp_path))[0] & ~1
    machine, at_s = Machine(elf), []
    machine.cpu.watch(address, lambda: at_s.append(machine.clock.now_s()))
    machine.run_until(0.05)
    assert len(at_s) == found(machine, 2)[1] == 5
    np.testing.assert_allclose(np.diff(at_s), 1e-3, atol=2e-6)


def test_the_unique_id_is_there(tmp_path):
    text = "int main(void) { for (int i = 0; i < 3; i++) found[i] = REG(0x1FFF7A10 + 4 * i); return 0; }"
    machine = alone(text, tmp_path, uid=bytes(range(12)))
    assert b"".join(word.to_bytes(4, "little") for word in found(machine, 3)) == bytes(range(12))


def test_no_memory_is_no_answer(tmp_path):
    machine = Machine(compiled("int main(void) { return (int)REG(0x30000000); }", tmp_path))
    with pytest.raises(ProgramError, match=r"at 0x080\w+, called from"):
        machine.run_until(0.01)


def test_a_stall_is_time_without_instructions(tmp_path):
    text = "int main(void) { systick(168000); uint32_t n = 0; while (n < 10000) n++, found[0] = milliseconds; for (;;) ; }"
    quick, late = (Machine(compiled(text, tmp_path), stalls=stalls) for stalls in ([], [(0.001, 0.02)]))
    for machine in (quick, late):
        machine.run_until(0.03)
    assert quick.clock.now_s() == pytest.approx(late.clock.now_s(), abs=1e-5)
    assert late.cpu.instructions == pytest.approx(quick.cpu.instructions / 3, rel=0.05)


def test_only_programs_for_arm_are_run(tmp_path):
    (tmp_path / "x.elf").write_bytes(b"\x7fELF\x02\x01" + bytes(60))
    with pytest.raises(ValueError, match="no program for ARM"):
        segments(tmp_path / "x.elf")


def test_memory_ends_where_the_parts_does(tmp_path):
    machine = Machine(compiled("int main(void) { return 0; }", tmp_path))
    assert len(machine.cpu.memory(RAM, 128 * 1024)) == 128 * 1024
    with pytest.raises(ProgramError, match="no memory"):
        machine.cpu.memory(RAM + 128 * 1024, 1)


FAULTS = """
__attribute__((section(".kept"), used)) volatile uint32_t starts;
void halt(void);
int main(void)
{
    found[0] = ++starts;
    if (starts == 1) { FAULT; }
    return 0;
}
"""


@pytest.mark.parametrize("fault", ["(void)REG(0x30000000)", '__asm volatile(".short 0xdeff")', "((void (*)(void))0x30000001)()"])
def test_a_fault_enters_its_handler_where_that_is_wanted(fault, tmp_path):
    """The handler asks for a reset; the second start comes to its end."""
    text = FAULTS.replace("FAULT", fault).replace(
        "void halt(void);", "void HardFault_Handler(void) { REG(0xE000ED0C) = 0x05FA0004; for (;;) ; }"
    )
    elf = compiled(text, tmp_path)
    machine = Machine(elf, hard_faults=True)
    machine.run_until(0.01)
    assert (machine.resets, found(machine)) == (1, [2])
    assert came_to_its_end(machine)
    with pytest.raises(ProgramError, match="at 0x"):
        Machine(elf).run_until(0.01)


@pytest.mark.parametrize("fault", ["(void)REG(0x30000000)", '__asm volatile("mov sp, %0\\n\\tpush {r0}" :: "r"(0x30000000) : "memory")'])
def test_a_fault_within_the_handler_or_without_a_stack_locks_up(fault, tmp_path):
    """Until its watchdog comes, which waits for nobody."""
    watched = "REG(0x40003000) = 0xCCCC;"
    handler = "void HardFault_Handler(void) { (void)REG(0x30000000); }"
    text = FAULTS.replace("FAULT", watched + fault).replace("void halt(void);", handler)
    machine = Machine(compiled(text, tmp_path), hard_faults=True)
    machine.run_until(0.4)
    assert machine.locked_up
    machine.run_until(0.6)  # 4096 counts of a quarter of 32 kHz
    assert (machine.watchdog_resets, machine.locked_up, found(machine)) == (1, False, [2])
    assert came_to_its_end(machine)
