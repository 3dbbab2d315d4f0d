/* An IMU of ST's family on SPI under Zephyr, for `calibrate.py record`: the driver of firmware/, its samples as text on the console.
 * docs/boards.md explains wiring, rates and what has been tried. */
#include <zephyr/devicetree.h>
#include <zephyr/drivers/spi.h>
#include <zephyr/kernel.h>
#include <zephyr/sys/printk.h>
#include <string.h>
#include "lsm6dsx.h"

#define ODR_HZ 104 /* 12 (which is 12.5), 26, 52, 104, 208, 417, 833 */
#define GYRO_FS_DPS 500
#define ACCEL_FS_G 4
#define SERIAL_NUMBER "bench-1" /* another one for each sensor */
#define HEADER_MS 4000 /* from one to the next: record waits 10 s for it */

BUILD_ASSERT(ODR_HZ == 12 || ODR_HZ == 26 || ODR_HZ == 52 || ODR_HZ == 104 || ODR_HZ == 208 || ODR_HZ == 417 || ODR_HZ == 833 ||
             ODR_HZ == 1667 || ODR_HZ == 3333 || ODR_HZ == 6667, "the sensor has no such data rate; 12 is 12.5");
BUILD_ASSERT(GYRO_FS_DPS == 125 || GYRO_FS_DPS == 250 || GYRO_FS_DPS == 500 || GYRO_FS_DPS == 1000 || GYRO_FS_DPS == 2000 ||
             GYRO_FS_DPS == 4000, "the gyroscope has no such range");
BUILD_ASSERT(ACCEL_FS_G == 2 || ACCEL_FS_G == 4 || ACCEL_FS_G == 8 || ACCEL_FS_G == 16, "the accelerometer has no such range");
/* A line has 61 bytes at most, ten bits each; 15 % to spare.  A console without a speed is USB all the way. */
#define CONSOLE_BAUD DT_PROP_OR(DT_CHOSEN(zephyr_console), current_speed, 100000000)
BUILD_ASSERT(61 * 10 * ODR_HZ / 100 * 115 <= CONSOLE_BAUD, "the console does not carry the lines of this data rate: its current-speed");

/* Mode 3.  A message is several transfers: chip select stays low, and the bus ours, until it is released.  The last 0 is a delay, which
 * newer versions of Zephyr take from the devicetree and warn of. */
#define OPERATION (SPI_OP_MODE_MASTER | SPI_TRANSFER_MSB | SPI_WORD_SET(8) | SPI_MODE_CPOL | SPI_MODE_CPHA | SPI_HOLD_ON_CS | SPI_LOCK_ON)
static const struct spi_dt_spec spi = SPI_DT_SPEC_GET(DT_NODELABEL(imu), OPERATION, 0);

/* What is sent where only the answer counts: not zeros, as a sensor that missed the address would take these for writes. */
static uint8_t ones[FIFO_WORDS * FIFO_WORD_BYTES];

static int transfer(const uint8_t *out, uint8_t *in, unsigned count)
{
    const struct spi_buf sent = {out ? (void *)out : ones, count}, received = {in, count}; /* null: what comes is dropped */
    const struct spi_buf_set out_set = {&sent, 1}, in_set = {&received, 1};
    return spi_transceive_dt(&spi, &out_set, &in_set) == 0 ? TRANSFER_DONE : TRANSFER_FAILED;
}

static void select_imu(int selected)
{
    if (!selected)
        spi_release_dt(&spi); /* it was selected by the first transfer */
}

static void wait_us(uint32_t us)
{
    k_usleep((int32_t)us);
}

/* Not by cycles: their microseconds do not wrap at 32 bits. */
static uint32_t time_us(void)
{
    return (uint32_t)k_ticks_to_us_floor64((uint64_t)k_uptime_ticks());
}

static const struct lsm6dsx_bus BUS = {transfer, select_imu, wait_us, time_us};
static struct lsm6dsx sensor;
static struct fifo_sample samples[FIFO_SAMPLES];

static const char *const NAMES[FAULTS] = {"overrun", "order", "parity", "tag", "hang", "zeros", "ones", "reset", "changed", "identity",
    "silent", "stamp", "incomplete", "starts", "lost", "rate"}; /* of enum fault, in its order */

static void print_header(void)
{
    const char *before = "# faults";
    const uint32_t rate_mhz = (uint32_t)(1000.0f * fifo_rate_hz(sensor.settings.odr, sensor.freq_fine) + 0.5f);
    printk("# gyro_fs_dps=%u accel_fs_g=%u odr_hz=%u.%03u serial=%s sensor=%s\n", sensor.settings.gyro_fs_dps, sensor.settings.accel_fs_g,
           rate_mhz / 1000, rate_mhz % 1000, SERIAL_NUMBER, sensor.chip->name);
    for (int n = 0; n < FAULTS; n++) { /* those above 0 */
        if (sensor.faults[n]) {
            printk("%s %s=%u", before, NAMES[n], sensor.faults[n]);
            before = "";
        }
    }
    printk("%st_us,gx,gy,gz,ax,ay,az,temp\n", before[0] ? "" : "\n");
}

int main(void)
{
    const struct lsm6dsx_settings settings = {GYRO_FS_DPS, ACCEL_FS_G, lsm6dsx_odr(ODR_HZ == 12 ? 12.5f : ODR_HZ), LPF1_OFF, 2};
    int64_t said_ms = k_uptime_get(), header_ms = -HEADER_MS;
    memset(ones, 0xFF, sizeof ones);
    for (; !spi_is_ready_dt(&spi); k_msleep(1000))
        printk("# the SPI is not ready: look at its status and its pins in the overlay\n");
    lsm6dsx_attach(&sensor, &BUS, &settings); /* the first polls look for the sensor and start it */
    for (;; k_msleep(1)) {
        const unsigned count = lsm6dsx_poll(&sensor, samples);
        for (unsigned n = 0; n < count; n++) {
            const int16_t *r = samples[n].registers;
            if (k_uptime_get() - header_ms >= HEADER_MS)
                header_ms = k_uptime_get(), print_header();
            printk("%u,%d,%d,%d,%d,%d,%d,%d\n", samples[n].t_us, r[0], r[1], r[2], r[3], r[4], r[5], r[6]);
        }
        if (!sensor.running && k_uptime_get() - said_ms >= 1000) {
            said_ms = k_uptime_get();
            printk("# no sensor runs: look at CS, SCK, SDI, SDO, 3.3 V, GND, and its ranges; WHO_AM_I reads %u\n", sensor.who);
        }
    }
}
