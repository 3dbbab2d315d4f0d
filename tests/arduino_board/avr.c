/* An Arduino's microcontroller in simavr, with the sensor of small_imu.c on its SPI:
 * avr MCU SS_PORT SS_BIT FLASH.bin WHO FREQ_FINE TICKS ANSWERS_S SPOILT < rows.  What the port sends is the standard output, and behind the
 * sensor's last row the least free memory, in bytes, is the standard error's. */
#include <stdio.h>
#include <stdlib.h>

#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>

#include "small_imu.h"

enum { CORE_HZ = 16000000, FLASH_MOST = 1 << 18, SPL = 0x5D, SPH = 0x5E };
enum { SPCR = 0x4C, SPSR = 0x4D, SPDR = 0x4E, SPI2X = 1, SPIF = 0x80 }; /* the same in both chips */

static avr_t *avr;
static uint8_t received;

static double now_us(void)
{
    return (double)avr->cycle * 1e6 / CORE_HZ;
}

static void on_select(struct avr_irq_t *irq, uint32_t level, void *param)
{
    (void)irq, (void)param;
    imu_select(!level);
}

/* simavr's own SPI takes 100 us for a byte, whatever its clock. */
static avr_cycle_count_t end_byte(struct avr_t *of, avr_cycle_count_t when, void *param)
{
    (void)when, (void)param;
    of->data[SPSR] |= SPIF;
    return 0;
}

static void write_spdr(struct avr_t *of, avr_io_addr_t address, uint8_t byte, void *param)
{
    static const unsigned dividers[] = {4, 16, 64, 128};
    (void)address, (void)param;
    const unsigned divider = dividers[of->data[SPCR] & 3] / (of->data[SPSR] & SPI2X ? 2 : 1);
    received = imu_exchange(byte, now_us());
    of->data[SPSR] &= (uint8_t)~SPIF;
    avr_cycle_timer_register(of, 8 * divider, end_byte, NULL);
}

static uint8_t read_spdr(struct avr_t *of, avr_io_addr_t address, void *param)
{
    (void)address, (void)param;
    of->data[SPSR] &= (uint8_t)~SPIF;
    return received;
}

static void on_port(struct avr_irq_t *irq, uint32_t byte, void *param)
{
    (void)irq, (void)param;
    putchar((int)byte);
}

int main(int count, char **words)
{
    static uint8_t flash[FLASH_MOST];
    FILE *file = count > 9 ? fopen(words[4], "rb") : NULL;
    const size_t size = file ? fread(flash, 1, sizeof flash, file) : 0;
    avr = avr_make_mcu_by_name(words[1]);
    if (!size || !avr)
        return 1;
    avr_init(avr);
    avr->frequency = CORE_HZ;
    avr->log = LOG_ERROR;
    avr_loadcode(avr, flash, (uint32_t)size, 0);
    avr->codeend = (uint32_t)size;
    imu_begin(words + 5);
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(words[2][0]), atoi(words[3])), on_select, NULL);
    avr->io[AVR_DATA_TO_IO(SPDR)].w.c = write_spdr;
    avr->io[AVR_DATA_TO_IO(SPDR)].r.c = read_spdr;
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_port, NULL);
    unsigned least = avr->ramend;
    while (imu_goes_on(now_us())) {
        const int state = avr_run(avr);
        const unsigned stack = avr->data[SPL] | (unsigned)avr->data[SPH] << 8;
        if (stack && stack < least)
            least = stack;
        if (state == cpu_Done || state == cpu_Crashed)
            return 2;
    }
    fprintf(stderr, "%u\n", least);
    return 0;
}
