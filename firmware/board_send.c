#include "board_send.h"

#include "board.h"
#include "board_registers.h"

#define USART1 0x40011000u
#define USART1_SR REG(USART1 + 0x00u)
#define USART1_DR REG(USART1 + 0x04u)
#define USART1_BRR REG(USART1 + 0x08u)
#define USART1_CR3 REG(USART1 + 0x14u)

enum {
    RING = 8192, /* 50 ms at 6667 Hz */
    SPINS = 100000,
    TC = 1u << 6,
    TXE = 1u << 7,
    DMAT = 1u << 7,
    STREAM = 7,
    CHANNEL = 4,
    CLEAR = 0x3Du << 22,
    COMPLETE = 1u << 27,
    ERRORS = 1u << 25,
    BYTE_BITS = 10,
    SPARE_MS = 10, /* of the time that bytes take on the wire */
};

static struct {
    uint8_t bytes[RING];
    uint32_t in, out, flying; /* counts that wrap; flying: bytes that DMA has been given */
    uint32_t began_ms, most_ms; /* of what is flying */
    uint32_t next_baud, until;  /* the port's next rate, or 0, and the byte from which on it counts */
    int by_dma;
} waiting;

void board_send_start(void)
{
    waiting.by_dma = board_has_dma();
    if (!waiting.by_dma)
        return;
    DMA2_PAR(STREAM) = (uint32_t)&USART1_DR;
    USART1_CR3 = DMAT;
}

static int rises(uint32_t flag)
{
    for (int spin = 0; spin < SPINS; spin++)
        if (USART1_SR & flag)
            return 1;
    return 0;
}

/* Bytes that may be sent at the port's present rate. */
static uint32_t ready(void)
{
    return (waiting.next_baud ? waiting.until : waiting.in) - waiting.out;
}

/* Without DMA (QEMU has none): at once. */
static void send_by_hand(void)
{
    while (ready() != 0u) {
        (void)rises(TXE);
        USART1_DR = waiting.bytes[waiting.out++ % RING];
    }
}

/* Whether DMA has nothing in hand. */
static int landed(void)
{
    if (!waiting.flying)
        return 1;
    if (((DMA2_HISR & (COMPLETE | ERRORS)) == 0u) && ((board_milliseconds() - waiting.began_ms) < waiting.most_ms))
        return 0;
    DMA2_CR(STREAM) = 0;
    for (int spin = 0; spin < DMA_SPINS && (DMA2_CR(STREAM) & DMA_ENABLE); spin++)
        ;
    DMA2_HIFCR = CLEAR;
    waiting.out += waiting.flying; /* after an error the rest of it is lost, and the host's CRC shows it */
    waiting.flying = 0;
    return 1;
}

/* The next rate, once the last byte of the present one has left the port; or should have, as an error of DMA leaves no sign of that. */
static void change_rate(void)
{
    if (!waiting.next_baud || ready())
        return;
    if (((USART1_SR & TC) != 0u) || ((board_milliseconds() - waiting.began_ms) >= waiting.most_ms)) {
        board_host_baud(waiting.next_baud);
        waiting.next_baud = 0;
    }
}

void board_send_on(void)
{
    if (waiting.by_dma && !landed())
        return;
    if (((waiting.in - waiting.out) > RING) || (ready() > RING)) { /* an upset of a bit: or old frames would be sent for hours */
        waiting.out = waiting.in;
        waiting.next_baud = 0;
    }
    change_rate();
    if (!waiting.by_dma)
        send_by_hand();
    if (!waiting.by_dma || !ready())
        return;
    const uint32_t at = waiting.out % RING, count = ready();
    waiting.flying = (count < (RING - at)) ? count : (RING - at);
    waiting.began_ms = board_milliseconds();
    waiting.most_ms = waiting.flying * BYTE_BITS * USART1_BRR / (APB2_HZ / 1000) * 5 / 4 + SPARE_MS;
    USART1_SR = ~(uint32_t)TC;
    DMA2_M0AR(STREAM) = (uint32_t)(waiting.bytes + at);
    DMA2_NDTR(STREAM) = waiting.flying;
    __asm volatile("dsb" ::: "memory"); /* DMA reads what has been written up to here */
    DMA2_CR(STREAM) = DMA_CHANNEL(CHANNEL) | DMA_FROM_MEMORY | DMA_MEMORY_STEPS | DMA_ENABLE;
}

int board_send(const uint8_t *bytes, unsigned count)
{
    board_send_on();
    if (count > (RING - (waiting.in - waiting.out)))
        return 0;
    for (unsigned n = 0; n < count; n++)
        waiting.bytes[waiting.in++ % RING] = bytes[n];
    board_send_on();
    return 1;
}

void board_send_baud(uint32_t baud)
{
    if (!waiting.next_baud)
        waiting.until = waiting.in;
    waiting.next_baud = baud;
    board_send_on();
}
