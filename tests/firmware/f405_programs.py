"""Small programs for the emulated STM32F405, compiled with the firmware's linker script; what they find lies at the start of the CCM."""

from conftest import ROOT
from emulator import build
from emulator.cpu import CCM, missing
from processes import run

HEAD = """
#include <stdint.h>
#define REG(a) (*(volatile uint32_t *)(a))
#define RCC_AHB1ENR REG(0x40023830)
#define RCC_APB2ENR REG(0x40023844)
#define GPIOA(o) REG(0x40020000 + (o))
#define SPI(o) REG(0x40013000 + (o))
#define STREAM(n, o) REG(0x40026410 + 24 * (n) + (o))
#define USART1(o) REG(0x40011000 + (o))
#define WFI() __asm volatile("wfi" ::: "memory")
#define CS(high) (GPIOA(0x18) = (high) ? 1u << 4 : 1u << 20)
extern volatile uint32_t found[64], milliseconds;
int main(void);
static inline void systick(uint32_t cycles) { REG(0xE000E014) = cycles - 1; REG(0xE000E018) = 0; REG(0xE000E010) = 7; }
static inline void irq(int n) { REG(0xE000E100 + 4 * (n / 32)) = 1u << (n & 31); }
/* Cycles since systick(0x1000000). */
static inline uint32_t cycles(void) { return 0xFFFFFF - REG(0xE000E018); }
static inline void spi_on(void)
{
    RCC_AHB1ENR |= 1u | 1u << 22;
    RCC_APB2ENR |= 1u << 12 | 1u << 4;
    CS(1);
    GPIOA(0x00) |= 1u << 8 | 2u << 10 | 2u << 12 | 2u << 14 | 2u << 18 | 2u << 20;
    GPIOA(0x20) |= 5u << 20 | 5u << 24 | 5u << 28;
    GPIOA(0x24) |= 7u << 4 | 7u << 8;
    SPI(0x00) = 1u << 9 | 1u << 8 | 3u << 3 | 1u << 2 | 3u;
    SPI(0x00) |= 1u << 6;
}
static inline uint8_t spi_byte(uint8_t out)
{
    while (!(SPI(0x08) & 2)) ;
    SPI(0x0C) = out;
    while (!(SPI(0x08) & 1)) ;
    return (uint8_t)SPI(0x0C);
}
static inline void spi_wait(void) { while (SPI(0x08) & 0x80) ; }
static inline uint8_t read_register(uint8_t address)
{
    CS(0);
    spi_byte(0x80 | address);
    const uint8_t value = spi_byte(0);
    spi_wait();
    CS(1);
    return value;
}
static inline void usart_on(void)
{
    RCC_AHB1ENR |= 1u | 1u << 22;
    RCC_APB2ENR |= 1u << 4;
    GPIOA(0x00) |= 2u << 18 | 2u << 20;
    GPIOA(0x24) |= 7u << 4 | 7u << 8;
    USART1(0x08) = 84000000u / 921600u;
    USART1(0x0C) = 1u << 13 | 1u << 3 | 1u << 2;
}
"""

START = (
    HEAD
    + """
extern uint32_t data_start[], data_end[], data_load[], bss_start[], bss_end[], stack_top[];
__attribute__((section(".ccm"), used)) volatile uint32_t found[64];
volatile uint32_t milliseconds;
void halt(void) { for (;;) ; }
__attribute__((weak)) void HardFault_Handler(void) { for (;;) ; }
__attribute__((weak)) void SysTick_Handler(void) { milliseconds++; }
__attribute__((weak)) void USART1_Handler(void) {}
void Reset_Handler(void)
{
    REG(0xE000ED88) |= 0xFu << 20;
    for (uint32_t *to = data_start, *from = data_load; to < data_end;) *to++ = *from++;
    for (uint32_t *to = bss_start; to < bss_end;) *to++ = 0;
    REG(0x40023804) = 16u | 336u << 6 | 7u << 24; /* 168 MHz */
    REG(0x40023808) = 5u << 10 | 4u << 13 | 2u;
    main();
    found[63] = 0x600D;
    for (;;) WFI();
}
typedef void (*vector)(void);
__attribute__((section(".vectors"), used)) static const vector VECTORS[98] = {
    [0] = (vector)(void *)stack_top, [1] = Reset_Handler, [2] = halt, [3] = HardFault_Handler, [15] = SysTick_Handler,
    [16 + 37] = USART1_Handler,
};
"""
)


def tools_missing():
    """Empty, or what is not installed."""
    return build.tools_missing() or missing()


def compiled(text, folder):
    """The ELF file of HEAD and a text with its ``main``."""
    sources, elf = (folder / "program.c", folder / "start.c"), folder / "program.elf"
    for source, content in zip(sources, (HEAD + text, START), strict=True):
        source.write_text(content)
    core = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
    flags = ["-std=c11", "-O2", "-ffreestanding", "-Wall", "-Werror", "-Wno-unused-function", "-nostartfiles", "--specs=nano.specs"]
    script = ROOT / "firmware" / "stm32f405.ld"
    made = run(["arm-none-eabi-gcc", *core, *flags, "-T", script, *sources, "-o", elf], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return elf


def found(machine, count=1):
    """The first numbers that the program has put down."""
    return list(machine.cpu.words(CCM, count))


def came_to_its_end(machine):
    return machine.cpu.words(CCM + 4 * 63, 1) == (0x600D,)
