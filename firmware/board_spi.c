#include "board_spi.h"

#include "board.h"
#include "board_registers.h"
#include "defaults.h"

#define SPI1 0x40013000u
#define SPI_CR1 REG(SPI1 + 0x00u)
#define SPI_CR2 REG(SPI1 + 0x04u)
#define SPI_SR REG(SPI1 + 0x08u)
#define SPI_DR REG(SPI1 + 0x0Cu)

#define POWER_OF_TWO(number) (((number) & ((number) - 1)) == 0)
_Static_assert((SPI_DIVIDER >= 16) && (SPI_DIVIDER <= 256) && POWER_OF_TWO(SPI_DIVIDER), "SPI_DIVIDER is one of 16, 32, 64, 128, 256");
_Static_assert((APB2_HZ / SPI_DIVIDER) <= 10000000, "the sensor's SPI ends at 10 MHz");

enum {
    /* A second on the bus: three words of 56 bits a sample; the temperature's words, a look at the FIFO's level each millisecond, and the
     * registers and the level that are read behind each of at most 300 bursts.  Of the clock, 80 %: between bytes that the core sends by
     * hand it rests. */
    SAMPLE_BITS = 3 * 56,
    OTHER_BITS = (13 * 56) + (1000 * 24) + (300 * 192),
    CARRIED_BITS = APB2_HZ / SPI_DIVIDER / 5 * 4,
    DIVIDER_CODE = 3 + (SPI_DIVIDER > 16) + (SPI_DIVIDER > 32) + (SPI_DIVIDER > 64) + (SPI_DIVIDER > 128),
    MODE3_MASTER = 3u | (1u << 2) | ((unsigned)DIVIDER_CODE << 3) | (1u << 6) | (3u << 8), /* enabled, chip select by hand */
    RXNE = 1u << 0,
    TXE = 1u << 1,
    BUSY = 1u << 7,
    BY_DMA = 3,
    RECEIVE = 0, /* DMA2's streams, both channel 3 */
    SEND = 3,
    CLEAR = 0x3Du | (0x3Du << 22),
    COMPLETE = 1u << 5, /* of stream 0 */
    ERRORS = (1u << 3) | (1u << 25),
    LONG = 32,                 /* bytes: below that, a byte at a time is quicker than setting up two streams */
    SPINS = 125 * SPI_DIVIDER, /* a byte takes 16 SPI_DIVIDER cycles of the core */
    SPARE_US = 1000,           /* of the time that bytes take on the wire */
};

/* The quickest unit's oscillator is 19 % above its nominal rate. */
_Static_assert((((double)ODR_HZ * 1.19 * SAMPLE_BITS) + OTHER_BITS) <= CARRIED_BITS,
               "the SPI does not carry this data rate: make SPI_DIVIDER=16");

static struct {
    const uint8_t *in; /* where the bytes go that DMA is fetching, or null */
    uint32_t began_us, most_us;
} fetching;

static const uint8_t ONES = 0xFFu; /* a sensor that has missed the address takes it for a read */

static void start_port(void)
{
    RCC_APB2RSTR |= 1u << 12;
    RCC_APB2RSTR &= ~(1u << 12);
    SPI_CR1 = MODE3_MASTER;
}

void board_spi_start(void)
{
    RCC_AHB1ENR |= 1u | (1u << 2);
    RCC_APB2ENR |= 1u << 12;
    board_spi_select(0);
    /* PA4 an output; PA5 to PA7 alternate function 5, quick; a pull-up on MISO, so that a sensor that is not there reads 0xFF. */
    GPIOA_MODER |= (1u << 8) | (2u << 10) | (2u << 12) | (2u << 14);
    GPIOA_OSPEEDR |= (2u << 8) | (2u << 10) | (2u << 14);
    GPIOA_PUPDR |= 1u << 12;
    GPIOA_AFRL |= (5u << 20) | (5u << 24) | (5u << 28);
    NVIC_ISER1 = 1u << (DMA2_STREAM0_IRQ - 32u);
    start_port();
}

/* It only wakes the core, so that what a burst has brought is looked at while the bus is as it was. */
void DMA2_Stream0_Handler(void)
{
    DMA2_CR(RECEIVE) &= ~(uint32_t)DMA_INTERRUPTS;
}

void board_spi_select(int selected)
{
    GPIOA_BSRR = selected ? (1u << (4u + 16u)) : (1u << 4);
}

static int rises(uint32_t flag)
{
    for (int spin = 0; spin < SPINS; spin++)
        if (SPI_SR & flag)
            return 1;
    return 0;
}

static void stop_dma(void)
{
    DMA2_CR(RECEIVE) = DMA2_CR(SEND) = 0;
    for (int spin = 0; spin < DMA_SPINS && ((DMA2_CR(RECEIVE) | DMA2_CR(SEND)) & DMA_ENABLE); spin++)
        ;
    DMA2_LIFCR = CLEAR;
    SPI_CR2 = 0;
    fetching.in = 0;
}

static int fail(void)
{
    stop_dma();
    start_port();
    return -1;
}

static int by_hand(const uint8_t *out, uint8_t *in, unsigned count)
{
    for (unsigned n = 0; n < count; n++) {
        if (!rises(TXE))
            return fail();
        SPI_DR = out ? out[n] : ONES;
        if (!rises(RXNE))
            return fail();
        const uint8_t byte = (uint8_t)SPI_DR;
        if (in != 0)
            in[n] = byte;
    }
    return 0;
}

static void begin_dma(uint8_t *in, unsigned count)
{
    DMA2_LIFCR = CLEAR;
    DMA2_PAR(RECEIVE) = DMA2_PAR(SEND) = (uint32_t)&SPI_DR;
    DMA2_M0AR(RECEIVE) = (uint32_t)in;
    DMA2_M0AR(SEND) = (uint32_t)&ONES;
    DMA2_NDTR(RECEIVE) = DMA2_NDTR(SEND) = count;
    SPI_CR2 = BY_DMA;
    DMA2_CR(RECEIVE) = DMA_CHANNEL(3) | DMA_URGENT | DMA_MEMORY_STEPS | DMA_INTERRUPTS | DMA_ENABLE;
    DMA2_CR(SEND) = DMA_CHANNEL(3) | DMA_FROM_MEMORY | DMA_ENABLE;
    fetching.in = in;
    fetching.began_us = board_microseconds();
    fetching.most_us = count * 8 * SPI_DIVIDER / (APB2_HZ / 1000000) * 5 / 4 + SPARE_US;
}

int board_spi_transfer(const uint8_t *out, uint8_t *in, unsigned count)
{
    if (fetching.in && (out || (fetching.in != in))) /* the transfer was abandoned */
        (void)fail();
    if (out || !in || (count < LONG) || !board_has_dma())
        return by_hand(out, in, count);
    if (!fetching.in) {
        begin_dma(in, count);
        return 1;
    }
    const uint32_t passed_us = board_microseconds() - fetching.began_us; /* before the flags: an interrupt may come between */
    const uint32_t flags = DMA2_LISR;
    if (((flags & (COMPLETE | ERRORS)) == 0u) && (passed_us < fetching.most_us))
        return 1;
    if (((flags & COMPLETE) == 0u) || ((flags & ERRORS) != 0u))
        return fail();
    stop_dma();
    __asm volatile("dsb" ::: "memory"); /* what is read from here on is what DMA has written */
    return 0;
}

int board_spi_carries(float odr_hz)
{
    return ((odr_hz * (float)SAMPLE_BITS) + (float)OTHER_BITS) <= (float)CARRIED_BITS;
}
