/* A board under Zephyr in simulated time, with the sensor of small_imu.c on its SPI:
 * board WHO FREQ_FINE TICKS ANSWERS_S SPOILT START_US READY_S < rows; after READY_S the SPI is ready.
 * Time passes by the bits on the bus, by what waits, and by what is printed: the console waits for each byte. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "small_imu.h"
#include "zephyr/drivers/spi.h"
#include "zephyr/kernel.h"
#include "zephyr/sys/printk.h"

enum { TICK_US = 100 }; /* CONFIG_SYS_CLOCK_TICKS_PER_SEC=10000 */

static const unsigned OPERATION = SPI_MODE_CPOL | SPI_MODE_CPHA | SPI_WORD_SET(8); /* and it is the controller */
static double now_us, began_us, ready_us;
static int held;

int app_main(void);

int32_t k_usleep(int32_t us)
{
    now_us += us + TICK_US;
    if (!imu_goes_on(now_us - began_us))
        exit(0);
    return 0;
}

int32_t k_msleep(int32_t ms)
{
    return k_usleep(1000 * ms);
}

int64_t k_uptime_get(void)
{
    return (int64_t)(now_us / 1000);
}

int64_t k_uptime_ticks(void)
{
    return (int64_t)(now_us / TICK_US);
}

uint64_t k_ticks_to_us_floor64(uint64_t ticks)
{
    return ticks * TICK_US;
}

void printk(const char *format, ...)
{
    va_list words;
    va_start(words, format);
    now_us += vprintf(format, words) * 10e6 / CONSOLE_SPEED;
    va_end(words);
}

bool spi_is_ready_dt(const struct spi_dt_spec *spec)
{
    (void)spec;
    return now_us - began_us >= ready_us;
}

int spi_transceive_dt(const struct spi_dt_spec *spec, const struct spi_buf_set *tx_bufs, const struct spi_buf_set *rx_bufs)
{
    const unsigned hold = SPI_HOLD_ON_CS | SPI_LOCK_ON;
    const struct spi_buf *out = tx_bufs->buffers, *in = rx_bufs->buffers;
    if ((spec->config.operation & ~hold) != OPERATION || tx_bufs->count != 1 || rx_bufs->count != 1 || out->len != in->len)
        abort(); /* nothing that the sensor would understand */
    if (!spi_is_ready_dt(spec))
        abort();
    if (!imu_goes_on(now_us - began_us))
        exit(0);
    if (!held)
        imu_select(1);
    for (size_t n = 0; n < out->len; n++) {
        now_us += 8e6 / spec->config.frequency;
        const uint8_t byte = imu_exchange(out->buf ? ((const uint8_t *)out->buf)[n] : 0, now_us - began_us);
        if (in->buf)
            ((uint8_t *)in->buf)[n] = byte;
    }
    held = (spec->config.operation & hold) == hold;
    if (!held)
        imu_select(0);
    return 0;
}

int spi_release_dt(const struct spi_dt_spec *spec)
{
    (void)spec;
    imu_select(0);
    held = 0;
    return 0;
}

int main(int count, char **words)
{
    (void)count;
    imu_begin(words + 1);
    now_us = began_us = atof(words[6]);
    ready_us = 1e6 * atof(words[7]);
    return app_main();
}
