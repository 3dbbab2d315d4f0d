/* STM32F405: 168 MHz from the internal oscillator, USART1 on PA9/PA10 (host), USART2 on PA2/PA3 (played sensor), SysTick each millisecond.
 *
 * RM0090 gives the registers.  QEMU has stubs for RCC, FLASH and GPIO, whose ready flags never rise: every wait ends by itself. */
#include "board.h"

#include "board_registers.h"
#include "board_send.h"
#include "board_watchdog.h"
#include "defaults.h"

#define RCC_CR REG(RCC + 0x00u)
#define RCC_PLLCFGR REG(RCC + 0x04u)
#define RCC_CFGR REG(RCC + 0x08u)
#define FLASH_ACR REG(0x40023C00u)
#define SYST_CSR REG(0xE000E010u)
#define SYST_RVR REG(0xE000E014u)
#define SYST_CVR REG(0xE000E018u)

/* USART registers. */
#define SR(base) REG((base) + 0x00u)
#define DR(base) REG((base) + 0x04u)
#define BRR(base) REG((base) + 0x08u)
#define CR1(base) REG((base) + 0x0Cu)

enum {
    SPINS = 100000,
    ORE = 1u << 3,
    RXNE = 1u << 5,
    TXE = 1u << 7,
    RXNEIE = 1u << 5,
    UE_TE_RE = (1u << 13) | (1u << 3) | (1u << 2),
    RING = 256, /* of received bytes; a power of two */
};

_Static_assert((BAUD >= BAUD_LEAST) && (BAUD <= BAUD_MOST), "BAUD is beyond what the host's port can: 9600 to 5250000");

static const uint32_t USART[PORTS] = {0x40011000u, 0x40004400u};

static struct {
    volatile uint8_t bytes[RING];
    volatile uint32_t in, out; /* counts that wrap; only the interrupt moves in, only board_read moves out */
} received[PORTS];

static volatile uint32_t milliseconds;
static int has_dma;

static int wait_for(volatile const uint32_t *reg, uint32_t mask, uint32_t value)
{
    for (int spin = 0; spin < SPINS; spin++)
        if ((*reg & mask) == value)
            return 1;
    return 0;
}

/* 16 MHz / 16 * 336 / 2 = 168 MHz.  If the PLL does not come up the core stays at 16 MHz, and no host will understand the baud rate:
 * there is no receiver. */
static void start_clock(void)
{
    FLASH_ACR = 5u | (7u << 8); /* 5 wait states, prefetch and caches: before the clock is raised */
    RCC_PLLCFGR = 16u | (336u << 6) | (7u << 24) | (2u << 28); /* the last as it is after reset: reserved, or the F446's PLLR */
    RCC_CR |= 1u << 24;
    if (!wait_for(&RCC_CR, 1u << 25, 1u << 25))
        return;
    RCC_CFGR = (5u << 10) | (4u << 13) | 2u; /* APB1 a quarter, APB2 a half, system clock from the PLL */
    wait_for(&RCC_CFGR, 3u << 2, 2u << 2);
}

/* Of a USART's clock; 16 is the least that a USART takes. */
static uint32_t divider(uint32_t hz, uint32_t baud)
{
    const uint32_t nearest = (hz + baud / 2) / baud;
    return nearest < 16 ? 16 : nearest;
}

void board_start(uint32_t baud)
{
    board_watchdog_start();
    start_clock();
    RCC_AHB1ENR |= 1u | (1u << 22);
    RCC_APB1ENR |= 1u << 17;
    RCC_APB2ENR |= 1u << 4;
    /* PA2, PA3, PA9, PA10: alternate function 7; a pull-up on what comes in, or an open line reads as a storm of bytes. */
    GPIOA_MODER |= (2u << 4) | (2u << 6) | (2u << 18) | (2u << 20);
    GPIOA_PUPDR |= (1u << 6) | (1u << 20);
    GPIOA_AFRL |= (7u << 8) | (7u << 12);
    GPIOA_AFRH |= (7u << 4) | (7u << 8);
    board_host_baud(baud);
    BRR(USART[SENSOR]) = divider(APB1_HZ, baud);
    for (int port = 0; port < PORTS; port++)
        CR1(USART[port]) = UE_TE_RE | RXNEIE;
    NVIC_ISER1 = (1u << (USART1_IRQ - 32u)) | (1u << (USART2_IRQ - 32u));
    SYST_RVR = CORE_HZ / 1000 - 1;
    SYST_CVR = 0;
    SYST_CSR = 7;
    /* A register of DMA2 keeps what is written to it, where there is a DMA2. */
    DMA2_PAR(0) = (uint32_t)&DR(USART[HOST]);
    has_dma = DMA2_PAR(0) == (uint32_t)&DR(USART[HOST]);
    board_send_start();
}

void board_host_baud(uint32_t baud)
{
    BRR(USART[HOST]) = divider(APB2_HZ, baud);
}

int board_has_dma(void)
{
    return has_dma;
}

uint32_t board_milliseconds(void)
{
    return milliseconds;
}

/* The counter counts down through a millisecond.  It may restart between two readings, and its interrupt may have to wait. */
uint32_t board_microseconds(void)
{
    static uint32_t last;
    uint32_t before, left, now;
    do {
        before = milliseconds;
        left = SYST_CVR;
    } while (before != milliseconds);
    now = 1000 * before + (CORE_HZ / 1000 - 1 - left) / (CORE_HZ / 1000000);
    if ((last - now) > 1000u) /* not a millisecond that is not counted yet: however long ago the last call was */
        last = now;
    return last;
}

void board_wait_us(uint32_t us)
{
    const uint32_t began = board_microseconds();
    while ((board_microseconds() - began) < us) {
        board_wait();
    }
}

int board_read(enum port port)
{
    const uint32_t out = received[port].out;
    if (out == received[port].in)
        return -1;
    const uint8_t byte = received[port].bytes[out % RING];
    received[port].out = out + 1;
    CR1(USART[port]) = UE_TE_RE | RXNEIE; /* there is room again */
    return byte;
}

int board_write(enum port port, const uint8_t *bytes, unsigned count)
{
    if (port == HOST)
        return board_send(bytes, count);
    for (unsigned n = 0; n < count; n++) {
        wait_for(&SR(USART[port]), TXE, TXE);
        DR(USART[port]) = bytes[n];
    }
    return 1;
}

void board_wait(void)
{
    board_send_on();
    __asm volatile("wfi");
}

void SysTick_Handler(void)
{
    milliseconds++;
}

/* Where the ring is full the byte stays in the port until there is room; what comes after it is then lost, unless the other end waits
 * for its answer. */
static void receive(enum port port)
{
    const uint32_t in = received[port].in, status = SR(USART[port]);
    if (((status & RXNE) != 0u) && ((in - received[port].out) == RING)) {
        CR1(USART[port]) = UE_TE_RE;
        return;
    }
    if (!(status & (RXNE | ORE)))
        return;
    const uint8_t byte = (uint8_t)DR(USART[port]); /* which also takes an overrun back */
    if ((status & RXNE) != 0u) {
        received[port].bytes[in % RING] = byte;
        received[port].in = in + 1;
    }
}

void USART1_Handler(void)
{
    receive(HOST);
}

void USART2_Handler(void)
{
    receive(SENSOR);
}
