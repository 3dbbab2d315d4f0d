/* Runs the model on samples from a file, and counts what it takes.  For QEMU: files and console by semihosting, time by TIM2.
 *
 * In: inputs.bin, float32 gx gy gz (rad/s) ax ay az (m/s^2) temp (degC).  Out: outputs.bin, float32 omega.  Then one line:
 * samples, nanoseconds of TIM2 in tinygc_step, nanoseconds of a thousand nops, result of the self-test.  Under -icount shift=0 an
 * instruction takes one nanosecond, so the nanoseconds are instructions, and the nops show whether they are. */
#include <stdint.h>

#include "board.h"
#include "board_spi.h"
#include "tinygc_model.h"

#define TIM2_CR1 (*(volatile uint32_t *)0x40000000)
#define TIM2_CNT (*(volatile uint32_t *)0x40000024)

enum { SYS_OPEN = 0x01, SYS_WRITE0 = 0x04, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT = 0x18, BATCH = 256 };
enum { READ_BINARY = 1, WRITE_BINARY = 5, APPLICATION_EXIT = 0x20026 };

static uint32_t semihost(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uint32_t open_file(const char *name, uint32_t mode)
{
    uint32_t length = 0;
    while (name[length] != 0)
        length++;
    const uint32_t block[3] = {(uint32_t)name, mode, length};
    return semihost(SYS_OPEN, block);
}

static void print_number(uint32_t value)
{
    char text[12], *at = text + sizeof text;
    *--at = 0;
    *--at = ' ';
    do
        *--at = (char)('0' + value % 10);
    while ((value /= 10) != 0);
    (void)semihost(SYS_WRITE0, at);
}

static uint32_t thousand_nops(void)
{
    const uint32_t began = TIM2_CNT;
    __asm volatile(".rept 1000\n\tnop\n\t.endr");
    return TIM2_CNT - began;
}

int main(void)
{
    static tinygc_input in[BATCH];
    static float omega[BATCH][3];
    static tinygc_state state;
    uint32_t samples = 0, ticks = 0;
    float worst;
    const uint32_t inputs = open_file("inputs.bin", READ_BINARY), outputs = open_file("outputs.bin", WRITE_BINARY);
    TIM2_CR1 = 1;
    tinygc_start(&state);
    for (;;) {
        const uint32_t read[3] = {inputs, (uint32_t)in, sizeof in};
        const uint32_t left = semihost(SYS_READ, read); /* bytes that were not read */
        if (left > sizeof in)
            break;
        const uint32_t count = ((sizeof in) - left) / sizeof in[0];
        if (count == 0)
            break;
        const uint32_t began = TIM2_CNT;
        for (uint32_t n = 0; n < count; n++)
            tinygc_step(&state, &in[n], omega[n]);
        ticks += TIM2_CNT - began;
        const uint32_t write[3] = {outputs, (uint32_t)omega, count * sizeof omega[0]};
        (void)semihost(SYS_WRITE, write);
        samples += count;
    }
    print_number(samples);
    print_number(ticks);
    print_number(thousand_nops());
    print_number((uint32_t)tinygc_self_test(&worst));
    print_number(worst > 0.0f);
    (void)semihost(SYS_EXIT, (void *)APPLICATION_EXIT);
    return 0;
}

/* Nothing here uses ports or bus; the vectors want their handlers. */
void SysTick_Handler(void)
{
}

void USART1_Handler(void)
{
}

void USART2_Handler(void)
{
}

void DMA2_Stream0_Handler(void)
{
}
