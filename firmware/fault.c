#include "fault.h"

static volatile int expected;

/* The load is an instruction of four bytes, which the handler steps over. */
uint32_t read_if_there(uint32_t address)
{
    uint32_t value = 0;
    expected = 1;
    __asm volatile("ldr.w %0, [%1]\n\tdsb" : "+r"(value) : "r"(address) : "memory");
    expected = 0;
    return value;
}

/* stacked: r0 to r3, r12, lr, pc, xpsr. */
__attribute__((used)) static void on_fault(uint32_t *stacked)
{
    while (!expected)
        ; /* any other fault stops here, where a debugger finds it; the watchdog of a product would reset */
    expected = 0;
    stacked[6] += 4;
}

__attribute__((naked)) void HardFault_Handler(void)
{
    __asm volatile("mov r0, sp\n\tb on_fault");
}
