#include "lsm6dsx.h"

#include "lsm6dsx_registers.h"

enum {
    BOOT_MOST_MS = 100,       /* from power-up, and from a reset, to a sensor that answers */
    TURN_ON_MS = 100,         /* gyroscope's start-up: 70 ms in the family's data sheets */
    SETTLE_MOST_MS = 2000,    /* of the filters */
    TRY_AGAIN_US = 100000,
    LOOK_AGAIN_US = 2000, /* a tenth of what the FIFO holds at 6667 Hz */
    QUIET_US = 15000, SILENCE_US = 50000, /* and four periods; a burst is due each 10 ms */
    BAD_BURSTS = 3,       /* in a row */
};

/* The last burst, if there is one, to its end; what it brought is dropped. */
static void abandon(struct lsm6dsx *sensor)
{
    if (sensor->burst) {
        lsm6dsx_transfer(sensor, 0, sensor->words, sensor->burst);
        sensor->bus->select(0);
    }
    sensor->burst = 0;
}

void lsm6dsx_attach(struct lsm6dsx *sensor, const struct lsm6dsx_bus *bus, const struct lsm6dsx_settings *settings)
{
    *sensor = (struct lsm6dsx){.bus = bus, .settings = *settings, .reason = FAULTS};
}

/* Whether it is one that the sensor need not have noticed. */
static int of_the_bus(enum fault fault)
{
    return fault == FAULT_HANG || fault == FAULT_ZEROS || fault == FAULT_ONES || fault == FAULT_IDENTITY;
}

/* Count a fault once, however often it is found again before the sensor runs. */
static enum fault stand_still(struct lsm6dsx *sensor, enum fault fault)
{
    const int once = sensor->running && (fault == FAULT_RESET || fault == FAULT_CHANGED); /* a bus that failed amid the registers looks so */
    const int goes_on = sensor->set_up && (once || of_the_bus(fault));
    abandon(sensor);
    sensor->tried_us = sensor->bus->time() - (sensor->set_up && !goes_on ? TRY_AGAIN_US : 0); /* a start at once, for the first time */
    sensor->set_up = (uint8_t)goes_on;
    sensor->running = 0;
    if (sensor->reason != fault)
        sensor->faults[fault]++;
    sensor->reason = (uint8_t)fault;
    return fault;
}

static enum fault identity_fault(uint8_t who)
{
    return who == LSM6DSX_WHO ? FAULTS : who == 0x00 ? FAULT_ZEROS : who == 0xFF ? FAULT_ONES : FAULT_IDENTITY;
}

static enum fault identify(struct lsm6dsx *sensor)
{
    sensor->failed = 0;
    sensor->who = lsm6dsx_read_one(sensor, WHO_AM_I);
    return sensor->failed ? FAULT_HANG : identity_fault(sensor->who);
}

/* Identity, then a software reset: both sensors off before it, as the family's application notes ask for. */
enum fault lsm6dsx_reset(struct lsm6dsx *sensor)
{
    abandon(sensor);
    sensor->set_up = 0;
    enum fault fault = identify(sensor);
    for (int ms = 0; fault != FAULTS && fault != FAULT_HANG && !sensor->found && ms < BOOT_MOST_MS; ms += 10) {
        sensor->bus->wait(10000); /* it may have been switched on just now */
        fault = identify(sensor);
    }
    if (fault != FAULTS)
        return fault;
    lsm6dsx_write(sensor, CTRL1_XL, 0);
    lsm6dsx_write(sensor, CTRL2_G, 0);
    lsm6dsx_write(sensor, CTRL3_C, SW_RESET | IF_INC);
    for (int ms = 0; ms < BOOT_MOST_MS && !sensor->failed; ms++) {
        sensor->bus->wait(1000);
        if (!(lsm6dsx_read_one(sensor, CTRL3_C) & SW_RESET))
            return sensor->failed ? FAULT_HANG : identify(sensor);
    }
    return sensor->failed ? FAULT_HANG : FAULT_RESET; /* which does not end */
}

static void settle(struct lsm6dsx *sensor)
{
    const float periods = 4.0f + (float)sensor->settings.accel_lpf2_divisor;
    const float ms = periods * 1000.0f / lsm6dsx_nominal_hz(sensor->settings.odr);
    sensor->bus->wait(1000u * (TURN_ON_MS + (ms < (float)SETTLE_MOST_MS ? (uint32_t)ms : (uint32_t)SETTLE_MOST_MS)));
}

static void run(struct lsm6dsx *sensor)
{
    sensor->reason = FAULTS;
    sensor->running = 1;
    sensor->bad_bursts = 0;
    sensor->data_us = sensor->bus->time();
}

enum fault lsm6dsx_start(struct lsm6dsx *sensor)
{
    uint8_t temperature[2];
    enum fault fault = lsm6dsx_reset(sensor);
    if (fault != FAULTS)
        return stand_still(sensor, fault);
    lsm6dsx_write_settings(sensor);
    settle(sensor);
    sensor->freq_fine = (int8_t)lsm6dsx_read_one(sensor, INTERNAL_FREQ_FINE); /* it may be another one before the sensors are on */
    fifo_begin(&sensor->fifo, sensor->settings.odr, sensor->freq_fine, 0);
    if (lsm6dsx_read_one(sensor, STATUS_REG) & TDA) {
        lsm6dsx_read(sensor, OUT_TEMP_L, temperature, 2);
        fifo_temperature(&sensor->fifo, (int16_t)(uint16_t)(temperature[0] | temperature[1] << 8));
    } /* else there is no sample before the first temperature comes through the FIFO */
    lsm6dsx_read(sensor, WHO_AM_I, sensor->kept, LSM6DSX_KEPT);
    sensor->who = sensor->kept[0];
    lsm6dsx_write(sensor, FIFO_CTRL4, CONTINUOUS);
    const int begun = lsm6dsx_read_one(sensor, FIFO_CTRL4) == CONTINUOUS;
    fault = sensor->failed ? FAULT_HANG : identity_fault(sensor->who);
    if (fault == FAULTS && !(begun && lsm6dsx_as_set(sensor)))
        fault = FAULT_CHANGED;
    if (fault != FAULTS)
        return stand_still(sensor, fault);
    run(sensor);
    sensor->set_up = sensor->found = 1;
    sensor->overrun = 0;
    return FAULTS;
}

/* Whether the registers are still those that were set; FAULTS, or what is wrong. */
static enum fault proof(struct lsm6dsx *sensor)
{
    uint8_t now[LSM6DSX_KEPT];
    sensor->failed = 0;
    lsm6dsx_read(sensor, WHO_AM_I, now, sizeof now);
    if (sensor->failed)
        return FAULT_HANG;
    sensor->who = now[0];
    return lsm6dsx_as_kept(sensor, now);
}

/* The words of a burst that has come in whole, if the registers behind it prove it. */
static unsigned take_burst(struct lsm6dsx *sensor, unsigned words, struct fifo_sample *out)
{
    const uint32_t word_us = (uint32_t)(1e6f / (WORDS_PER_SLOT * fifo_rate_hz(sensor->settings.odr, sensor->freq_fine)));
    const enum fault fault = proof(sensor);
    const unsigned bad = fifo_unknown_tag(sensor->words, words);
    unsigned samples = 0;
    if (fault != FAULTS) {
        stand_still(sensor, fault);
        return 0;
    }
    sensor->faults[FAULT_TAG] += bad < words;
    if (bad == MANY_UNKNOWN) {
        sensor->faults[FAULT_TAG]++;
        fifo_gap(&sensor->fifo);
        if (++sensor->bad_bursts >= BAD_BURSTS)
            stand_still(sensor, FAULT_SILENT);
        return 0;
    }
    sensor->bad_bursts = 0;
    sensor->data_us = sensor->bus->time();
    for (unsigned n = 0; n < words; n++) {
        const uint32_t made_us = sensor->burst_us - word_us * (sensor->level - n);
        if (n == bad) /* and with it the slot in hand: a line that stuck for so long spoilt the word before, too */
            fifo_gap(&sensor->fifo);
        else
            samples += (unsigned)fifo_take(&sensor->fifo, sensor->words + FIFO_WORD_BYTES * n, made_us, sensor->faults, out + samples);
    }
    if (sensor->fifo.bad_stamps >= BAD_STAMPS)
        stand_still(sensor, FAULT_STAMP);
    return samples;
}

/* The burst that is on its way, or has just been requested. */
static unsigned go_on(struct lsm6dsx *sensor, struct fifo_sample *out)
{
    const unsigned words = sensor->burst / FIFO_WORD_BYTES;
    const uint32_t passed_us = sensor->bus->time() - sensor->burst_us;
    const int result = sensor->bus->transfer(0, sensor->words, sensor->burst);
    if (result == TRANSFER_BUSY && passed_us < TRANSFER_MOST_US)
        return 0;
    sensor->burst = 0;
    sensor->bus->select(0);
    if (result == TRANSFER_DONE)
        return take_burst(sensor, words, out);
    stand_still(sensor, FAULT_HANG);
    return 0;
}

/* Words in the FIFO that are worth a burst. */
static unsigned words_due(struct lsm6dsx *sensor)
{
    uint8_t status[2];
    sensor->failed = 0;
    lsm6dsx_read(sensor, FIFO_STATUS1, status, 2);
    if (sensor->failed) {
        stand_still(sensor, FAULT_HANG);
        return 0;
    }
    if (status[1] & FIFO_UNUSED) { /* no answer, or another chip */
        const enum fault fault = proof(sensor);
        if (fault != FAULTS)
            stand_still(sensor, fault);
        return 0;
    }
    if ((status[1] & FIFO_OVERRUN) && !sensor->overrun) {
        sensor->faults[FAULT_OVERRUN]++;
        fifo_gap(&sensor->fifo);
    }
    sensor->overrun = (status[1] & FIFO_OVERRUN) != 0;
    const unsigned words = status[0] | (status[1] & 3u) << 8, most = FIFO_WORDS;
    sensor->level = (uint16_t)words;
    return status[1] & FIFO_WATERMARK || words >= most ? (words < most ? words : most) : 0;
}

/* A bus that failed may be back, and the sensor as it was: then its stamps show what is missing.  Else it is started again. */
static void try_again(struct lsm6dsx *sensor)
{
    const uint32_t now_us = sensor->bus->time(), passed_us = now_us - sensor->tried_us;
    if (!sensor->found || passed_us < (sensor->set_up ? LOOK_AGAIN_US : TRY_AGAIN_US))
        return;
    if (!sensor->set_up) {
        sensor->faults[FAULT_STARTS]++;
        lsm6dsx_start(sensor);
        return;
    }
    const enum fault fault = proof(sensor);
    if (fault != FAULTS) {
        stand_still(sensor, fault);
        return;
    }
    fifo_gap(&sensor->fifo);
    sensor->overrun = 1; /* if it ran over meanwhile, that is no other fault */
    run(sensor);
}

unsigned lsm6dsx_poll(struct lsm6dsx *sensor, struct fifo_sample *out)
{
    const uint32_t now_us = sensor->bus->time();
    if (!sensor->running) {
        try_again(sensor);
        return 0;
    }
    if (sensor->burst)
        return go_on(sensor, out);
    const unsigned words = words_due(sensor);
    if (words) {
        const uint8_t address = READ | FIFO_DATA_OUT_TAG;
        sensor->bus->select(1);
        lsm6dsx_transfer(sensor, &address, 0, 1);
        sensor->burst = words * FIFO_WORD_BYTES;
        sensor->burst_us = now_us;
        return go_on(sensor, out);
    }
    const uint32_t periods_us = (uint32_t)(4e6f / lsm6dsx_nominal_hz(sensor->settings.odr)), quiet_us = now_us - sensor->data_us;
    if (sensor->running && quiet_us > QUIET_US + periods_us) {
        const enum fault fault = proof(sensor);
        if (fault != FAULTS || quiet_us > SILENCE_US + periods_us)
            stand_still(sensor, fault == FAULTS ? FAULT_SILENT : fault);
    }
    return 0;
}
