/* The ASM330LHH on SPI, for any C99 target.
 *
 * Samples come from its FIFO with the sensor's own stamps.  Gyroscope, accelerometer and stamp of one sample are of one time slot, and a
 * burst counts only where the registers that are read behind it are those that were set: what is not certain is left out and counted,
 * never guessed.  Every wait has a bound.
 *
 * WHO_AM_I is 0x6B in the ASM330LHHX, ASM330LHHXG1, ASM330LHB, ISM330DHCX, LSM6DSR and LSM6DSRX as well: it tells that somebody of the
 * family is there, not who. */
#ifndef LSM6DSX_H
#define LSM6DSX_H

#include <stdint.h>

#include "lsm6dsx_fifo.h"

/* The four functions of a target.  SPI mode 3 (or 0), at most 10 MHz. */
struct lsm6dsx_bus {
    /* Exchange bytes; out may be null (zeros are sent), or in (what comes is dropped).  TRANSFER_DONE, TRANSFER_FAILED within a bounded
     * time, or TRANSFER_BUSY: it goes on by itself, and the driver asks again with the same arguments.  A target that waits never says
     * the last. */
    int (*transfer)(const uint8_t *out, uint8_t *in, unsigned count);
    void (*select)(int selected); /* chip select; it is low where selected */
    void (*wait)(uint32_t microseconds);
    uint32_t (*time)(void); /* microseconds; wraps at 32 bits */
};

enum { TRANSFER_FAILED = -1, TRANSFER_DONE = 0, TRANSFER_BUSY = 1 };

/* Data rates by their code: 12.5, 26, 52, 104, 208, 417, 833, 1667, 3333, 6667 Hz. */
enum { LSM6DSX_SLOWEST = 1, LSM6DSX_QUICKEST = 10, LSM6DSX_WHO = 0x6B, LPF1_OFF = 0xFF };

struct lsm6dsx_settings {
    uint16_t gyro_fs_dps;        /* 125, 250, 500, 1000, 2000, 4000 */
    uint16_t accel_fs_g;         /* 2, 4, 8, 16 */
    uint8_t odr;                 /* LSM6DSX_SLOWEST to LSM6DSX_QUICKEST, of both */
    uint8_t gyro_lpf1;           /* FTYPE 0 to 7, or LPF1_OFF */
    uint16_t accel_lpf2_divisor; /* bandwidth: data rate over 2 (without LPF2), 4, 10, 20, 45, 100, 200, 400, 800 */
};

/* WHO_AM_I to CTRL10_C as they were read back: what the session was recorded with. */
enum { LSM6DSX_KEPT = 11 };

struct lsm6dsx {
    const struct lsm6dsx_bus *bus;
    struct lsm6dsx_settings settings;
    struct lsm6dsx_fifo fifo;
    uint32_t faults[FAULTS];
    uint8_t kept[LSM6DSX_KEPT];
    int8_t freq_fine;
    uint8_t who;     /* the last WHO_AM_I that was read */
    uint8_t running; /* whether samples are to be expected */
    uint8_t set_up;  /* whether its registers are those that were set, as far as we know */
    uint8_t found;   /* whether it ever ran */
    uint8_t failed;  /* whether a transfer failed since this was cleared */
    uint8_t reason;  /* of standing still: a fault, or FAULTS */
    uint8_t bad_bursts, overrun;
    unsigned burst; /* bytes that are on their way, or 0 */
    uint16_t level; /* words in the FIFO when it was last read */
    uint32_t burst_us, data_us, tried_us; /* when the burst began, the last one ended, a start was last tried */
    uint8_t words[FIFO_WORDS * FIFO_WORD_BYTES];
};

/* The code of a nominal rate, within 5 %, or 0. */
uint8_t lsm6dsx_odr(float hz);

float lsm6dsx_nominal_hz(uint8_t odr);

/* Whether the sensor has them. */
int lsm6dsx_possible(const struct lsm6dsx_settings *settings);

/* Forget everything.  No transfer. */
void lsm6dsx_attach(struct lsm6dsx *sensor, const struct lsm6dsx_bus *bus, const struct lsm6dsx_settings *settings);

/* Reset, set, settle, read INTERNAL_FREQ_FINE, begin the FIFO.  Takes 0.1 s and some periods, at most 2.4 s.  FAULTS where it runs,
 * else the fault, which is counted. */
enum fault lsm6dsx_start(struct lsm6dsx *sensor);

/* The samples that have come since; most that there can be: FIFO_SAMPLES.  Call it each millisecond or so.  After a fault of the bus it
 * goes on where the sensor is as it was set; else it starts the sensor again, at most ten times a second. */
unsigned lsm6dsx_poll(struct lsm6dsx *sensor, struct fifo_sample *out);

/* What follows is between the driver's own files. */

enum { TRANSFER_MOST_US = 20000 }; /* the longest burst takes 1 ms at 5 MHz */

/* A transfer to its end; TRANSFER_FAILED, or TRANSFER_BUSY where it has none within TRANSFER_MOST_US. */
int lsm6dsx_transfer(struct lsm6dsx *sensor, const uint8_t *out, uint8_t *in, unsigned count);

/* Zeros where a transfer failed. */
void lsm6dsx_read(struct lsm6dsx *sensor, uint8_t address, uint8_t *bytes, unsigned count);
uint8_t lsm6dsx_read_one(struct lsm6dsx *sensor, uint8_t address);
void lsm6dsx_write(struct lsm6dsx *sensor, uint8_t address, uint8_t value);

/* Identity and software reset; FAULTS, or what is wrong. */
enum fault lsm6dsx_reset(struct lsm6dsx *sensor);

/* Both sensors on, the FIFO set up but in bypass. */
void lsm6dsx_write_settings(struct lsm6dsx *sensor);

/* Whether the registers that make up a sample were read back as they were written. */
int lsm6dsx_as_set(const struct lsm6dsx *sensor);

/* Whether WHO_AM_I to CTRL10_C are still those of the start; FAULTS, or what is wrong. */
enum fault lsm6dsx_as_kept(const struct lsm6dsx *sensor, const uint8_t now[LSM6DSX_KEPT]);

#endif
