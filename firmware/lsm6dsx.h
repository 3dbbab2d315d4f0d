/* The ASM330LHH and its sibling LSM6DSO on SPI, for any C99 target, also one whose int has 16 bits.
 *
 * Samples come from the sensor's FIFO with its own stamps.  Gyroscope, accelerometer and stamp of one sample are of one time slot, and a
 * burst counts only where the registers that are read behind it are those that were set: what is not certain is left out and counted,
 * never guessed.
 *
 * Call lsm6dsx_poll each millisecond or so, and nothing else is needed: it looks for the sensor, starts it, and starts it again after a
 * fault.  It waits for nothing.  On a bus of at least 1.6 MHz it takes 5 ms at most, and those only for a burst of 96 words on a target
 * whose transfers wait: half a millisecond everywhere else, or 2 ms where a transfer fails.  6667 Hz need 4 MHz, as
 * 20 000 words come in a second; the sensor does 10 MHz.
 *
 * With I2C off (CTRL4_C) and DEVICE_CONF set (CTRL9_XL), as here, the sensor's own pull-up at CS is off: a target that lets the line float
 * while it starts needs one of its own. */
#ifndef LSM6DSX_H
#define LSM6DSX_H

#include <stdbool.h>
#include <stdint.h>

#include "lsm6dsx_chips.h"
#include "lsm6dsx_fifo.h"
#include "lsm6dsx_rate.h"

/* The four functions of a target.  SPI mode 3 (or 0). */
struct lsm6dsx_bus {
    /* Exchange bytes; out may be null (send 0xFF: to a sensor that has missed the address a zero would be a write), or in (what comes
     * is dropped).  TRANSFER_DONE, TRANSFER_FAILED within a millisecond (a burst: within 5), or TRANSFER_BUSY: it goes on by itself, and
     * the driver asks again with the same arguments.  Other arguments, or an end of the selection, end one that still goes on.  A target
     * that waits never returns TRANSFER_BUSY. */
    int (*transfer)(const uint8_t *out, uint8_t *in, unsigned count);
    void (*select)(int selected); /* chip select; it is low where selected */
    void (*wait)(uint32_t microseconds); /* only lsm6dsx_start and lsm6dsx_self_test call it */
    uint32_t (*time)(void); /* microseconds; wraps at 32 bits */
};

enum { TRANSFER_FAILED = -1, TRANSFER_DONE = 0, TRANSFER_BUSY = 1 };

/* Data rates by their code: 12.5, 26, 52, 104, 208, 417, 833, 1667, 3333, 6667 Hz. */
enum { LSM6DSX_SLOWEST = 1, LSM6DSX_QUICKEST = 10, LPF1_OFF = 0xFF };

struct lsm6dsx_settings {
    uint16_t gyro_fs_dps;        /* 125, 250, 500, 1000, 2000, and with an ASM330LHH 4000 */
    uint16_t accel_fs_g;         /* 2, 4, 8, 16 */
    uint8_t odr;                 /* LSM6DSX_SLOWEST to LSM6DSX_QUICKEST, of both */
    uint8_t gyro_lpf1;           /* FTYPE 0 to 7, or LPF1_OFF */
    uint16_t accel_lpf2_divisor; /* bandwidth: data rate over 2 (without LPF2), 4, 10, 20, 45, 100, 200, 400, 800 */
};

/* On the way to a sensor that runs. */
enum lsm6dsx_step { STEP_STANDS, STEP_IDENTIFY, STEP_OFF, STEP_RESET, STEP_BLANK, STEP_ON, STEP_RUNS };

struct lsm6dsx {
    const struct lsm6dsx_bus *bus;
    const struct lsm6dsx_chip *chip; /* that was found last, or null */
    struct lsm6dsx_settings settings;
    struct lsm6dsx_fifo fifo;
    struct lsm6dsx_rate rate;
    uint32_t faults[FAULTS];
    uint8_t kept[LSM6DSX_KEPT]; /* as read back at the last start: what the session was recorded with */
    int8_t freq_fine;
    uint8_t who;    /* the last WHO_AM_I that was read */
    uint8_t bad_bursts;
    enum lsm6dsx_step step;
    enum fault reason; /* of standing still, or FAULTS */
    bool running;  /* whether words are to be expected; samples, once its filters have settled (fifo.settled) */
    bool starting; /* whether a requested start has neither succeeded nor failed */
    bool set_up;   /* whether its registers are those that were set, as far as we know */
    bool found;    /* whether it ever ran */
    bool failed;   /* whether a transfer failed since this was cleared; then none is made */
    bool overrun;
    unsigned burst; /* bytes that are on their way, or 0 */
    uint16_t level; /* words in the FIFO when it was last read */
    uint32_t burst_us, data_us;          /* when the burst began, the last one ended */
    uint32_t word_us;                    /* a word of the FIFO comes each so many */
    uint32_t step_us, requested_us;          /* when the step began, a start was requested */
    uint32_t tried_us, again_us;         /* when a start last failed, and how long behind that comes the next */
    uint32_t unreadable_us;              /* when it stopped, or was last made readable */
    uint8_t words[FIFO_WORDS * FIFO_WORD_BYTES];
};

/* The code of a nominal rate, within 5 %, or 0. */
uint8_t lsm6dsx_odr(float hz);

/* 0 where there is no such code. */
float lsm6dsx_nominal_hz(uint8_t odr);

/* Whether a chip has them; null: whether they could be some chip's, ranges left open. */
bool lsm6dsx_possible(const struct lsm6dsx_settings *settings, const struct lsm6dsx_chip *chip);

/* Time slots behind a start that are no samples, as the filters have not settled: 70 ms and some slots, up to 597 slots. */
uint16_t lsm6dsx_unsettled(const struct lsm6dsx_settings *settings, int8_t freq_fine);

/* Forget everything; the first poll begins to look for the sensor.  No transfer. */
void lsm6dsx_attach(struct lsm6dsx *sensor, const struct lsm6dsx_bus *bus, const struct lsm6dsx_settings *settings);

/* Start it again at the next polls, with the settings that it has by then: 26 ms from here its registers are proved and its FIFO runs,
 * and the first sample comes behind the unsettled slots.  starting is true until then, or until it has failed. */
void lsm6dsx_restart(struct lsm6dsx *sensor);

/* The samples that have come since; most that there can be: FIFO_SAMPLES.  After a fault of the bus it goes on where the sensor is as it
 * was set; else it starts the sensor again, at once where that has run for 50 ms, else ten times a second, also a sensor that has never
 * answered.  out may be null while the sensor does not run. */
unsigned lsm6dsx_poll(struct lsm6dsx *sensor, struct fifo_sample *out);

/* For small targets: lsm6dsx_restart, and polls until it runs or has failed; 0.3 s at most.  FAULTS where it runs, LSM6DSX_IMPOSSIBLE
 * where it has no such settings (then nothing is tried again), or the fault, which is counted. */
enum fault lsm6dsx_start(struct lsm6dsx *sensor);

/* What follows is between the driver's own files. */

/* A transfer to its end; false where it failed, or did not end within a millisecond, or one before it did so. */
bool lsm6dsx_transfer(struct lsm6dsx *sensor, const uint8_t *out, uint8_t *in, unsigned count);

/* Zeros where a transfer failed. */
void lsm6dsx_read(struct lsm6dsx *sensor, uint8_t address, uint8_t *bytes, unsigned count);
uint8_t lsm6dsx_read_one(struct lsm6dsx *sensor, uint8_t address);
void lsm6dsx_write(struct lsm6dsx *sensor, uint8_t address, uint8_t value);

/* FAULTS where a chip has it, else what that means. */
enum fault lsm6dsx_identity_fault(uint8_t who);

void lsm6dsx_next(struct lsm6dsx *sensor, enum lsm6dsx_step step);

/* A step from STEP_IDENTIFY towards STEP_BLANK, a sensor as it is behind a reset; FAULTS, or what is wrong. */
enum fault lsm6dsx_reset_step(struct lsm6dsx *sensor);

/* A step from STEP_IDENTIFY towards STEP_RUNS; FAULTS, LSM6DSX_IMPOSSIBLE, or what is wrong. */
enum fault lsm6dsx_start_step(struct lsm6dsx *sensor);

/* False while a burst is on its way, whose samples are not wanted any more. */
bool lsm6dsx_bus_is_free(struct lsm6dsx *sensor);

/* FIFO_CTRL1 to CTRL10_C as the settings want them. */
void lsm6dsx_image(const struct lsm6dsx *sensor, uint8_t image[LSM6DSX_KEPT]);

/* Both sensors on, the FIFO set up but in bypass. */
void lsm6dsx_write_settings(struct lsm6dsx *sensor);

/* Whether so many registers were read back as they are to be, in the bits that have a meaning. */
bool lsm6dsx_alike(const uint8_t *known, const uint8_t *image, const uint8_t *now, unsigned count);

/* Whether the registers are still those of the start; FAULTS, or what is wrong. */
enum fault lsm6dsx_as_kept(const struct lsm6dsx *sensor, const uint8_t now[LSM6DSX_KEPT]);

#endif
