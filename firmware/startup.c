/* From reset to main: the FPU, the data, the vectors. */
#include <stdint.h>

#include "board.h"
#include "board_registers.h"
#include "board_spi.h"
#include "fault.h"

#define CPACR REG(0xE000ED88u)

extern uint32_t data_start[], data_end[], data_load[], bss_start[], bss_end[], stack_top[];

int main(void);

void Reset_Handler(void)
{
    /* Full access to coprocessors 10 and 11: without it the first floating-point instruction is a fault. */
    CPACR |= 0xFu << 20;
    __asm volatile("dsb\n\tisb" ::: "memory");
    for (uint32_t *to = data_start, *from = data_load; to < data_end;)
        *to++ = *from++;
    for (uint32_t *to = bss_start; to < bss_end;)
        *to++ = 0;
    (void)main();
    fault_reset(); /* it has no end */
}

typedef void (*vector)(void);

/* 16 of the core, 82 of the device. */
__attribute__((section(".vectors"), used)) static const vector VECTORS[16 + 82] = {
    [0] = (vector)(void *)stack_top,
    [1] = Reset_Handler,
    [2] = fault_reset,       /* NMI: nothing is set to cause one */
    [3] = HardFault_Handler, /* and with it the faults of memory, bus and usage, which are not enabled apart */
    [15] = SysTick_Handler,
    [16 + USART1_IRQ] = USART1_Handler,
    [16 + USART2_IRQ] = USART2_Handler,
    [16 + DMA2_STREAM0_IRQ] = DMA2_Stream0_Handler,
};
