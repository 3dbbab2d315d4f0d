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
    FAULT_STAMP,      /* the sensor's stamp does not go on by whole periods, or by how many is not certain */
    FAULT_INCOMPLETE, /* time slots without gyroscope, accelerometer or stamp */
    FAULT_STARTS,     /* starts again, whether they succeeded or not */
    FAULT_LOST,       /* sample periods without a sample, as the stamps show them */
    FAULT_RATE,       /* registers as set, but samples come at another rate */
    FAULTS,
    LSM6DSX_IMPOSSIBLE /* no fault: the sensor is there, and has no such settings */
};

/* TAG_SENSOR of a word. */
enum { TAG_GYRO = 1, TAG_ACCEL = 2, TAG_TEMPERATURE = 3, TAG_STAMP = 4, TAG_CONFIGURATION = 5 };

/* Words of a burst at most; a target with little RAM, as an Uno, has fewer.  The sensor's FIFO has 3 kB for words of seven bytes: 438. */
#ifndef FIFO_WORDS
#ifdef __AVR_ATmega328P__
#define FIFO_WORDS 24
#else
#define FIFO_WORDS 96
#endif
#endif

enum {
    FIFO_WORD_BYTES = 7,
    FIFO_SAMPLES = FIFO_WORDS / 3 + 2, /* of a burst at most */
    WORDS_PER_SLOT = 3,                /* and a temperature now and then */
    BAD_STAMPS = 4,                    /* in a row: then the sensor's time has restarted */
    MANY_UNKNOWN = 0x7FFF,
    STAMPS_STRAY = 5,  /* ticks: two stamps are apart as their slots are, to so many; each may be two late or early, and a tick is whole */
    CLOCKS_SHARE = 16, /* the two clocks may differ by a sixteenth: 1 to 3 % of a target's RC oscillator, 0.1 % of the sensor's */
    MASKED = 0x7FFD,   /* from here up a value is a mark of the sensor's: its filter has not settled.  0x7FFF is clipped, too */
    MASKED_MOST = 512, /* slots at the highest rate that are dropped for such marks: 77 ms, as long again as a gyroscope takes; */
    MASKED_LEAST = 8,  /* at others as many in that time, and so many */
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
    int16_t warmth; /* its temperature, if it has one */
    uint32_t ticks, made_us; /* its stamp; the target's time when its first word was made */
    /* Between slots. */
    uint8_t ordered, next;               /* whether the next TAG_CNT is known, and which it is */
    uint8_t warm, waiting, whole_before; /* whether the temperature is known; the last slot had another; it was whole */
    int16_t temperature, waiting_warmth;
    /* After a start: slots that are no samples, further ones that may be masked; whether both are over. */
    uint16_t unsettled, masked;
    uint8_t settled;
    /* The stamp that the next one goes on from. */
    uint8_t anchored, bad_stamps, last_count;
    uint8_t counted, unsure;         /* whether no slot can have been missed since; one may be missed from the slot in hand on */
    uint32_t slots;                  /* that began since */
    uint32_t last_ticks, stamped_us; /* the target's time when it was made */
    uint32_t contradicted;           /* the last stamp that the target's clock did not agree with */
    int64_t place_q32;               /* ticks from the middle of the tick that it names to the time of its slot, as estimated */
    /* The sample period in ticks: what it is at least and at most, the middle, half of what lies between. */
    uint64_t shortest_q32, longest_q32, period_q32, doubt_q32;
    uint8_t odr, gain; /* 2^-gain of one's deviation goes into the place */
    uint32_t learned_from, learned, learned_again; /* a stamp, periods since then, at how many to learn again */
    /* Time. */
    uint64_t tick_q32, time_q32; /* us of a tick, 25 / (1 + 0.0015 f); us of the last stamp, before the first sample of the last one */
    uint32_t number, now_us;     /* of the last sample; the target's time when it was made */
    uint8_t joined, streamed;    /* whether there was a sample since the start, and whether ever */
};

/* True data rate in Hz, 6667 (1 + 0.0015 f) / coefficient. */
float fifo_rate_hz(uint8_t odr, int8_t freq_fine);

/* True tick of the stamps in 2^-32 us, 25 us / (1 + 0.0015 f). */
uint64_t fifo_tick_q32(int8_t freq_fine);

/* The sensor has been started: its stamps restart, time and number go on by the target's clock.  unsettled: time slots that come first
 * and are no samples, as the filters have not settled; those with a value that the sensor has masked are not among them, for a while. */
void fifo_begin(struct lsm6dsx_fifo *fifo, uint8_t odr, int8_t freq_fine, uint16_t unsettled);

/* Words are missing: what follows need not follow on. */
void fifo_gap(struct lsm6dsx_fifo *fifo);

void fifo_temperature(struct lsm6dsx_fifo *fifo, int16_t value);

/* The place of the one word whose tag is none, its parity even; count where there is no such word.  MANY_UNKNOWN where there are more, or
 * fewer than a slot's words behind it: then no word can be trusted, as the bytes may have slipped. */
unsigned fifo_unknown_tag(const uint8_t *words, unsigned count);

/* What a word with TAG_STAMP holds, in ticks. */
uint32_t fifo_stamp(const uint8_t *word);

/* Take a word that was made at the target's time now_us; 1 where it completes a sample. */
int fifo_take(struct lsm6dsx_fifo *fifo, const uint8_t *word, uint32_t now_us, uint32_t faults[FAULTS], struct fifo_sample *out);

#endif
