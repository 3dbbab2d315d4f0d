/* From the words of the FIFO to samples with a stamp and a number.  No bus in here. */
#ifndef LSM6DSX_FIFO_H
#define LSM6DSX_FIFO_H

#include <stdint.h>

/* What can go wrong; each is counted.  docs/firmware.md has the same list. */
enum fault {
    FAULT_OVERRUN,    /* the FIFO was full: the oldest words are gone */
    FAULT_ORDER,      /* TAG_CNT does not follow, or a word came twice */
    FAULT_PARITY,     /* words whose tag has odd parity */
    FAULT_TAG,        /* bursts with tags that there are none of */
    FAULT_HANG,       /* a transfer did not end */
    FAULT_ZEROS,      /* the bus answers 0x00 */
    FAULT_ONES,       /* the bus answers 0xFF */
    FAULT_RESET,      /* the sensor has reset itself (it is switched off), or its reset does not end */
    FAULT_CHANGED,    /* a register is not what was set */
    FAULT_IDENTITY,   /* WHO_AM_I is another's */
    FAULT_SILENT,     /* registers are right, but no words come */
    FAULT_STAMP,      /* the sensor's stamp does not go on by whole periods */
    FAULT_INCOMPLETE, /* time slots without gyroscope, accelerometer or stamp */
    FAULT_STARTS,     /* starts again, whether they succeeded or not */
    FAULT_LOST,       /* sample periods without a sample, as the stamps show them */
    FAULT_RATE,       /* registers as set, but samples come at another rate */
    FAULTS
};

enum {
    FIFO_WORD_BYTES = 7,
    FIFO_WORDS = 96,                   /* in a burst; the FIFO holds more than four times as many */
    FIFO_SAMPLES = FIFO_WORDS / 3 + 2, /* of a burst at most */
    WORDS_PER_SLOT = 3,                /* and a temperature now and then */
    BAD_STAMPS = 4,                    /* in a row: then the sensor's time has restarted */
    MANY_UNKNOWN = 0xFFFF,
};

struct fifo_sample {
    uint32_t t_us;        /* the sensor's time in true microseconds; wraps */
    uint32_t number;      /* counts sample periods, so those that are lost show */
    int16_t registers[7]; /* gx gy gz ax ay az temp */
};

struct lsm6dsx_fifo {
    /* The time slot in hand. */
    uint8_t have, count, spoilt, open; /* open: 0 none, 1 the first behind a gap, 2 another */
    int16_t values[6];
    uint32_t ticks;
    /* Between slots. */
    uint8_t ordered, next;  /* whether the next TAG_CNT is known, and which it is */
    uint8_t warm, anchored; /* whether the temperature is known, and a stamp that the next one goes on from */
    uint8_t bad_stamps, last_count;
    int16_t temperature;
    uint32_t last_ticks;
    /* Time.  A tick is 25 us / (1 + 0.0015 f), a sample period the quotient of the nominal rates in ticks. */
    uint32_t period_q16, elapsed_q16; /* ticks; place within the tick at last_ticks */
    uint64_t tick_q32, time_q32;      /* us of a tick; us of the last sample */
    uint32_t number, now_us;          /* of the last sample; the target's time when it was made */
    uint8_t streamed;                 /* whether there is a last sample */
};

/* True data rate in Hz, 6667 (1 + 0.0015 f) / coefficient. */
float fifo_rate_hz(uint8_t odr, int8_t freq_fine);

/* True tick of the stamps in 2^-32 us, 25 us / (1 + 0.0015 f). */
uint64_t fifo_tick_q32(int8_t freq_fine);

/* The sensor has been started: its stamps restart, time and number go on by the target's clock.  unsettled: time slots that come first
 * and are no samples, as the filters have not settled. */
void fifo_begin(struct lsm6dsx_fifo *fifo, uint8_t odr, int8_t freq_fine, uint16_t unsettled);

/* Words are missing: what follows need not follow on. */
void fifo_gap(struct lsm6dsx_fifo *fifo);

void fifo_temperature(struct lsm6dsx_fifo *fifo, int16_t value);

/* The place of the one word whose tag is none, its parity even; count where there is no such word.  MANY_UNKNOWN where there are more, or
 * fewer than a slot's words behind it: then no word can be trusted, as the bytes may have slipped. */
unsigned fifo_unknown_tag(const uint8_t *words, unsigned count);

/* Take a word that was made at the target's time now_us; 1 where it completes a sample. */
int fifo_take(struct lsm6dsx_fifo *fifo, const uint8_t *word, uint32_t now_us, uint32_t faults[FAULTS], struct fifo_sample *out);

#endif
