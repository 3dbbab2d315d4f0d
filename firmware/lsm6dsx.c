#include "lsm6dsx.h"

#include "lsm6dsx_registers.h"

enum { BAD_BURSTS = 3 }; /* in a row */

static const uint32_t BOOT_MOST_US = 100000, BOOT_AGAIN_US = 10000; /* from power-up to a sensor that answers */
static const uint32_t TRY_AGAIN_US = 100000, RAN_LEAST_US = 50000, UNREADABLE_US = 100000;
static const uint32_t LOOK_AGAIN_US = 2000; /* a tenth of what the FIFO holds at 6667 Hz: 3 kB are 438 words */
static const uint32_t BURST_MOST_US = 20000; /* it takes 1 ms at 5.25 MHz */
static const uint32_t ABSENT_US = 1000000; /* without words; a temperature comes each 80 ms */
static const uint32_t HELD_US = 5000; /* a poll's most: a core that was held for longer amid a look does not know of when that is */
static const uint32_t QUIET_US = 15000, SILENCE_US = 50000; /* and four periods; a burst is due each 10 ms */

void lsm6dsx_attach(struct lsm6dsx *sensor, const struct lsm6dsx_bus *bus, const struct lsm6dsx_settings *settings)
{
    *sensor = (struct lsm6dsx){.bus = bus, .settings = *settings, .reason = FAULTS};
    lsm6dsx_restart(sensor);
}

void lsm6dsx_restart(struct lsm6dsx *sensor)
{
    sensor->running = false;
    sensor->set_up = false;
    sensor->starting = true;
    lsm6dsx_next(sensor, STEP_IDENTIFY);
    sensor->requested_us = sensor->step_us;
}

/* Those that the sensor need not have noticed: registers read as none of its own, or transfers do not end. */
static bool is_unreadable(enum fault fault)
{
    return (fault == FAULT_ZEROS) || (fault == FAULT_ONES) || (fault == FAULT_IDENTITY);
}

static bool is_of_the_bus(enum fault fault)
{
    return (fault == FAULT_HANG) || is_unreadable(fault);
}

/* By the wrong IF_INC all registers read as one, by the wrong SIM as 0xFF.  Written blind, both are right again; nothing else changes,
 * neither in a sensor that is as it was set, nor in one that does not hear. */
static void make_readable(struct lsm6dsx *sensor)
{
    sensor->failed = false;
    lsm6dsx_write(sensor, CTRL3_C, BDU | IF_INC);
    sensor->unreadable_us = sensor->bus->time();
}

/* Count a fault once, however often it is found again before the sensor runs. */
static void stand_still(struct lsm6dsx *sensor, enum fault fault)
{
    const bool of_sensor = (fault == FAULT_RESET) || (fault == FAULT_CHANGED);
    const bool once = of_sensor && (sensor->running || is_of_the_bus(sensor->reason)); /* a bus that failed amid the registers looks so */
    const bool goes_on = sensor->set_up && (once || is_of_the_bus(fault));
    sensor->tried_us = sensor->bus->time();
    const bool at_once = sensor->set_up && ((sensor->tried_us - sensor->step_us) >= RAN_LEAST_US); /* as the last start was of use */
    sensor->again_us = goes_on ? LOOK_AGAIN_US : (at_once ? 0u : TRY_AGAIN_US);
    sensor->set_up = goes_on;
    if (sensor->running)
        sensor->unreadable_us = sensor->tried_us;
    sensor->running = false;
    sensor->starting = false;
    sensor->step = STEP_STANDS;
    if ((sensor->reason != fault) && (fault < FAULTS))
        sensor->faults[fault]++;
    sensor->reason = fault;
}

/* Words are missing. */
static void gap(struct lsm6dsx *sensor)
{
    fifo_gap(&sensor->fifo);
    rate_gap(&sensor->rate);
}

/* Whether the FIFO ran over, by FIFO_STATUS2, whose mark of that a read clears. */
static bool ran_over(struct lsm6dsx *sensor, uint8_t status)
{
    const bool overrun = (status & FIFO_OVERRUN) != 0u;
    if (overrun) {
        sensor->faults[FAULT_OVERRUN] += (sensor->overrun || ((status & FIFO_UNUSED) != 0u)) ? 0u : 1u;
        sensor->overrun = true;
        gap(sensor);
    }
    return overrun;
}

static void run(struct lsm6dsx *sensor)
{
    rate_gap(&sensor->rate);
    sensor->reason = FAULTS;
    sensor->running = true;
    sensor->starting = false;
    sensor->bad_bursts = 0;
    sensor->data_us = sensor->bus->time();
    sensor->step_us = sensor->data_us;
}

/* Whether the registers are still those that were set; FAULTS, or what is wrong. */
static enum fault proof(struct lsm6dsx *sensor)
{
    uint8_t now[LSM6DSX_KEPT];
    sensor->failed = false;
    lsm6dsx_read(sensor, FIFO_CTRL1, now, LSM6DSX_KEPT);
    if (sensor->failed)
        return FAULT_HANG;
    sensor->who = now[LSM6DSX_KEPT_WHO];
    return lsm6dsx_as_kept(sensor, now);
}

/* Whether words have come for twice the time that its filters take, and a fifth of a second, and no slot was a sample; or for a second
 * more, and none was a temperature. */
static bool never_settles(const struct lsm6dsx *sensor)
{
    const bool settled = sensor->fifo.settled != 0u;
    if (settled && (sensor->fifo.warm != 0u))
        return false;
    const float slots = 16.0f + (2.0f * (float)lsm6dsx_unsettled(&sensor->settings, sensor->freq_fine));
    const float most_us = (settled ? 1.2e6f : 2e5f) + (1e6f * slots / fifo_rate_hz(sensor->settings.odr, sensor->freq_fine));
    return (float)(sensor->bus->time() - sensor->step_us) > most_us;
}

/* What a burst without a false tag has brought. */
static unsigned take_words(struct lsm6dsx *sensor, unsigned words, unsigned bad, struct fifo_sample *out)
{
    const uint8_t odr = sensor->settings.odr;
    const uint32_t parity = sensor->faults[FAULT_PARITY];
    unsigned samples = 0;
    for (unsigned n = 0; n < words; n++) {
        const uint8_t *word = &sensor->words[FIFO_WORD_BYTES * n];
        const uint32_t made_us = sensor->burst_us - (sensor->word_us * (sensor->level - n));
        if (n == bad) { /* and with it the slot in hand: a line that stuck for so long spoilt the word before, too */
            gap(sensor);
        } else {
            rate_take(&sensor->rate, word, odr);
            samples += (unsigned)fifo_take(&sensor->fifo, word, made_us, sensor->faults, &out[samples]);
        }
    }
    sensor->rate.samples += samples;
    if (sensor->faults[FAULT_PARITY] != parity)
        rate_gap(&sensor->rate);
    const bool emptied = sensor->level <= words; /* else it is not known when its last word was made: a backlog may have lost others */
    const bool samples_due = (sensor->fifo.settled != 0u) && (sensor->fifo.warm != 0u);
    if ((emptied && rate_is_wrong(&sensor->rate, odr, sensor->freq_fine, sensor->burst_us, samples_due)) || never_settles(sensor))
        stand_still(sensor, FAULT_RATE);
    else if (sensor->fifo.bad_stamps >= BAD_STAMPS)
        stand_still(sensor, rate_steps_are_odd(&sensor->rate) ? FAULT_RATE : FAULT_STAMP);
    return samples;
}

/* A burst that has come in whole: it counts if the registers behind it prove it, if the FIFO did not run over meanwhile, which mixes its
 * slots, and if its tags do not show that bytes have slipped. */
static unsigned take_burst(struct lsm6dsx *sensor, unsigned words, struct fifo_sample *out)
{
    const enum fault fault = proof(sensor);
    const unsigned bad = fifo_unknown_tag(sensor->words, words);
    uint8_t status[2];
    if (fault != FAULTS) {
        stand_still(sensor, fault);
        return 0;
    }
    lsm6dsx_read(sensor, FIFO_STATUS1, status, 2);
    if (sensor->failed) {
        stand_still(sensor, FAULT_HANG);
        return 0;
    }
    if (ran_over(sensor, status[1])) {
        sensor->data_us = sensor->bus->time();
        return 0;
    }
    if ((bad < words) || (bad == MANY_UNKNOWN))
        sensor->faults[FAULT_TAG]++;
    if (bad == MANY_UNKNOWN) {
        gap(sensor);
        sensor->bad_bursts++;
        if (sensor->bad_bursts >= BAD_BURSTS)
            stand_still(sensor, FAULT_SILENT);
        return 0;
    }
    sensor->bad_bursts = 0;
    sensor->data_us = sensor->bus->time();
    return take_words(sensor, words, bad, out);
}

/* The burst that is on its way, or has just been requested. */
static unsigned go_on(struct lsm6dsx *sensor, struct fifo_sample *out)
{
    const unsigned words = sensor->burst / FIFO_WORD_BYTES;
    const uint32_t passed_us = sensor->bus->time() - sensor->burst_us;
    const int result = sensor->bus->transfer(0, sensor->words, sensor->burst);
    if ((result == TRANSFER_BUSY) && (passed_us < BURST_MOST_US))
        return 0;
    sensor->burst = 0;
    sensor->bus->select(0);
    if (!sensor->running) /* a start was requested meanwhile */
        return 0;
    if (result == TRANSFER_DONE)
        return take_burst(sensor, words, out);
    stand_still(sensor, FAULT_HANG);
    return 0;
}

bool lsm6dsx_bus_is_free(struct lsm6dsx *sensor)
{
    if (sensor->burst > 0u)
        (void)go_on(sensor, 0);
    return sensor->burst == 0u;
}

/* Words in the FIFO that are worth a burst. */
static unsigned words_due(struct lsm6dsx *sensor)
{
    const unsigned most = FIFO_WORDS;
    uint8_t status[2];
    sensor->failed = false;
    lsm6dsx_read(sensor, FIFO_STATUS1, status, 2);
    if (sensor->failed) {
        stand_still(sensor, FAULT_HANG);
        return 0;
    }
    if ((status[1] & FIFO_UNUSED) != 0) { /* no answer, or another chip */
        const enum fault fault = proof(sensor);
        if (fault != FAULTS)
            stand_still(sensor, fault);
        return 0;
    }
    sensor->overrun = ran_over(sensor, status[1]);
    sensor->level = (uint16_t)(status[0] | ((status[1] & 3u) << 8));
    if (sensor->level >= most)
        return most;
    return ((status[1] & FIFO_WATERMARK) != 0) ? sensor->level : 0u;
}

/* Behind an absence the temperature of before is none: samples wait for the next one, and count as lost. */
static void forget_old_warmth(struct lsm6dsx *sensor, uint32_t now_us)
{
    if ((now_us - sensor->data_us) > ABSENT_US)
        sensor->fifo.warm = 0;
}

static unsigned request_burst(struct lsm6dsx *sensor, unsigned words, struct fifo_sample *out)
{
    const uint8_t address = READ | FIFO_DATA_OUT_TAG;
    sensor->bus->select(1);
    if (!lsm6dsx_transfer(sensor, &address, 0, 1)) {
        sensor->bus->select(0);
        stand_still(sensor, FAULT_HANG);
        return 0;
    }
    sensor->burst = words * FIFO_WORD_BYTES;
    return go_on(sensor, out);
}

/* No words are due: but there is an end to that, and the FIFO may not be as it was set. */
static void listen(struct lsm6dsx *sensor, uint32_t looked_us)
{
    const uint32_t periods_us = (uint32_t)(4e6f / lsm6dsx_nominal_hz(sensor->settings.odr));
    const uint32_t quiet_us = looked_us - sensor->data_us;
    if (quiet_us > (QUIET_US + periods_us)) {
        const enum fault fault = proof(sensor);
        if ((fault != FAULTS) || (quiet_us > (SILENCE_US + periods_us)))
            stand_still(sensor, (fault == FAULTS) ? FAULT_SILENT : fault);
    }
}

/* A bus that failed may be back, and the sensor as it was: then its stamps show what is missing.  Else it is started again. */
static void look(struct lsm6dsx *sensor)
{
    const enum fault fault = proof(sensor);
    if (fault != FAULTS) {
        if (is_unreadable(fault) && ((sensor->bus->time() - sensor->unreadable_us) >= UNREADABLE_US))
            make_readable(sensor);
        stand_still(sensor, fault);
        return;
    }
    forget_old_warmth(sensor, sensor->bus->time());
    fifo_gap(&sensor->fifo);
    sensor->overrun = true; /* if it ran over meanwhile, that is no other fault */
    run(sensor);
}

/* A step of a start.  A sensor that has just been switched on may take its time to answer. */
static void start_on(struct lsm6dsx *sensor)
{
    const enum fault fault = lsm6dsx_start_step(sensor);
    const uint32_t now_us = sensor->bus->time();
    if (fault == FAULTS) {
        if (sensor->step == STEP_RUNS) {
            sensor->set_up = true;
            sensor->found = true;
            sensor->overrun = false;
            run(sensor);
        }
    } else if (!sensor->found && sensor->starting && is_unreadable(fault) && ((now_us - sensor->requested_us) < BOOT_MOST_US)) {
        sensor->step = STEP_STANDS;
        sensor->tried_us = now_us;
        sensor->again_us = BOOT_AGAIN_US;
    } else {
        stand_still(sensor, fault);
    }
}

/* What there is to do while it does not run. */
static void stand(struct lsm6dsx *sensor)
{
    if (sensor->step != STEP_STANDS) {
        start_on(sensor);
        return;
    }
    if (((sensor->reason == LSM6DSX_IMPOSSIBLE) && !sensor->starting) || ((sensor->bus->time() - sensor->tried_us) < sensor->again_us))
        return;
    if (sensor->set_up) {
        look(sensor);
        return;
    }
    if (sensor->found)
        sensor->faults[FAULT_STARTS]++;
    if (is_unreadable(sensor->reason) && (sensor->found || (sensor->reason != FAULT_ZEROS))) /* zeros: it may be starting up */
        make_readable(sensor);
    lsm6dsx_next(sensor, STEP_IDENTIFY);
    start_on(sensor);
}

unsigned lsm6dsx_poll(struct lsm6dsx *sensor, struct fifo_sample *out)
{
    unsigned samples = 0;
    if (sensor->burst > 0u) {
        samples = go_on(sensor, out);
    } else if (!sensor->running) {
        stand(sensor);
    } else {
        const uint32_t looked_us = sensor->bus->time();
        const unsigned words = words_due(sensor);
        if ((sensor->bus->time() - looked_us) > HELD_US)
            return 0; /* what it holds is of an unknown time: the next poll looks again */
        sensor->burst_us = looked_us;
        forget_old_warmth(sensor, looked_us);
        if (words > 0u)
            samples = request_burst(sensor, words, out);
        else if (sensor->running)
            listen(sensor, looked_us);
    }
    return samples;
}

enum fault lsm6dsx_start(struct lsm6dsx *sensor)
{
    lsm6dsx_restart(sensor);
    while (sensor->starting) {
        (void)lsm6dsx_poll(sensor, 0);
        sensor->bus->wait(1000);
    }
    return sensor->reason;
}
