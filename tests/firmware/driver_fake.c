/* The four functions that the driver wants, over an array of registers and a queue of FIFO words.  No model of the sensor: it answers what
 * the test has put there. */
#include <string.h>

#include "lsm6dsx.h"
#include "lsm6dsx_registers.h"
#include "lsm6dsx_self_test.h"
#include "fault.h"

enum { MOST_WORDS = 1 << 20, LOG = 1024 };
enum { ANSWERS, HANGS, BUSY_FOR_EVER, ZEROS, ONES, FAILS_LATE };

struct lsm6dsx sensor;
uint8_t registers[128];
uint8_t stuck; /* a register that takes nothing, or 0 */
uint8_t who = 0x6B; /* WHO_AM_I */
uint8_t turned, turned_bits; /* a register some of whose bits read the wrong way round, */
uint32_t turned_until_us;    /* until then */
uint8_t fine; /* INTERNAL_FREQ_FINE, which a reset does not change */
uint8_t bytes[MOST_WORDS][FIFO_WORD_BYTES];
uint32_t words_in, words_out, now_us, byte_us, transfers, logged, breaks_after, held_at, lost;
/* held_at: the word, from 1, behind which a core is held amid a burst, until the FIFO has run over by so many words as lost says */
uint32_t held_us, held_from_us; /* a core that is held so long, once, amid the first look at the FIFO's level from then on */
uint32_t wakes_us;             /* before that a sensor answers zeros, and takes nothing */
uint32_t longest_us, waits;    /* the longest poll; calls of the function that waits */
uint16_t accesses[LOG]; /* address with READ, value << 8 */
uint32_t accessed_us[LOG];
int behaviour, selected, overrun, busy_polls, pushed, shaken; /* pushed: by the force of the self-test, in 256 LSB; shaken: LSB */
int line; /* a behaviour of the line, from a time to another */
int ramp; /* LSB of the gyroscope in a second: it turns faster and faster */
uint32_t line_from_us, line_until_us;

static struct {
    int begun, polls;
    uint8_t address;
    unsigned place; /* within the FIFO word */
} at;

void reset_registers(void)
{
    memset(registers, 0, sizeof registers);
    registers[WHO_AM_I] = who;
    registers[CTRL3_C] = IF_INC;
    registers[CTRL9_XL] = 0xE0;
    registers[INTERNAL_FREQ_FINE] = fine;
    words_out = words_in;
}

static void note(uint8_t address, uint8_t value)
{
    if (logged == LOG)
        return;
    accessed_us[logged] = now_us;
    accesses[logged++] = (uint16_t)(address | value << 8);
}

static void get_ready(uint8_t address)
{
    const uint32_t words = registers[FIFO_CTRL4] & 6 ? words_in - words_out : 0;
    const unsigned watermark = registers[FIFO_CTRL1];
    note(address, 0);
    registers[FIFO_STATUS1] = (uint8_t)words;
    registers[FIFO_STATUS1 + 1] = (uint8_t)((words >> 8 & 3) | (watermark && words >= watermark ? FIFO_WATERMARK : 0) | (overrun ? 0x48 : 0));
    if ((address & 0x7F) == FIFO_STATUS1) {
        overrun = 0;
        if (now_us >= held_from_us) {
            now_us += held_us;
            held_us = 0;
        }
    }
    registers[STATUS_REG] = XLDA | GDA;
    for (int i = 0; i < 3; i++) { /* the self-test's answer */
        const int gyro = (registers[CTRL5_C] & ST_G_POSITIVE ? 256 * pushed : 0) + (transfers % 8 < 4 ? shaken : 0) +
                         (int)((int64_t)ramp * now_us / 1000000);
        registers[OUTX_L_G + 2 * i] = (uint8_t)gyro;
        registers[OUTX_L_G + 2 * i + 1] = (uint8_t)(gyro >> 8);
        registers[OUTX_L_A + 2 * i + 1] = registers[CTRL5_C] & ST_XL_POSITIVE ? (uint8_t)pushed : 0;
    }
}

static uint8_t answer(void)
{
    const uint8_t address = at.address & 0x7F;
    if (address >= FIFO_DATA_OUT_TAG) {
        if (words_out == words_in)
            return 0;
        const uint8_t byte = bytes[words_out % MOST_WORDS][at.place++];
        if (at.place == FIFO_WORD_BYTES) {
            at.place = 0;
            words_out++;
            if (breaks_after && words_out == breaks_after)
                behaviour = ZEROS;
            if (held_at && words_out == held_at) {
                words_out += lost;
                overrun = 1;
            }
        }
        return byte;
    }
    if (registers[CTRL3_C] & IF_INC)
        at.address++;
    if (registers[CTRL3_C] & SIM) /* it answers on the other line */
        return 0xFF;
    return (uint8_t)(registers[address] ^ (address == turned && now_us < turned_until_us ? turned_bits : 0));
}

static void take(uint8_t value)
{
    note(at.address, value);
    if (!stuck || at.address != stuck)
        registers[at.address] = value;
    if (at.address == CTRL3_C && (value & SW_RESET))
        reset_registers();
    at.address++;
}

static int transfer(const uint8_t *out, uint8_t *in, unsigned count)
{
    const int from_here = now_us >= line_from_us && now_us < line_until_us ? line : ANSWERS;
    transfers++;
    if (behaviour == FAILS_LATE || from_here == FAILS_LATE)
        now_us += count > 40 ? 4900 : 990;
    if (behaviour == HANGS)
        now_us += 2 * count;
    if (behaviour == HANGS || behaviour == FAILS_LATE || from_here == FAILS_LATE)
        return TRANSFER_FAILED;
    if (behaviour == BUSY_FOR_EVER || from_here == BUSY_FOR_EVER) /* asked again as soon as it says so */
        return TRANSFER_BUSY;
    if (!out && count > 32 && at.polls++ < busy_polls)
        return TRANSFER_BUSY;
    at.polls = 0;
    for (unsigned n = 0; n < count; n++) {
        const int stands = now_us >= line_from_us && now_us < line_until_us ? line : now_us < wakes_us ? ZEROS : ANSWERS;
        const int as = behaviour == ANSWERS ? stands : behaviour;
        uint8_t byte = 0xFF;
        now_us += byte_us;
        if (as == HANGS) { /* it neither hears nor answers */
        } else if (!at.begun) { /* also amid a transfer, if it did not hear the address */
            at.begun = 1;
            at.address = out ? out[n] : 0xFF;
            if (at.address & READ)
                get_ready(at.address);
        } else if (at.address & READ) {
            byte = answer();
        } else if (behaviour == ANSWERS && now_us >= wakes_us) {
            take(out ? out[n] : 0xFF);
        }
        if (in)
            in[n] = as == ZEROS ? 0x00 : as == ONES ? 0xFF : byte;
    }
    return TRANSFER_DONE;
}

static void select_chip(int on)
{
    selected = on;
    at.begun = 0;
    at.place = 0;
}

static void wait_us(uint32_t us)
{
    waits++;
    now_us += us;
}

static uint32_t time_us(void)
{
    return ++now_us;
}

static const struct lsm6dsx_bus BUS = {transfer, select_chip, wait_us, time_us};

void attach(uint16_t gyro_fs_dps, uint16_t accel_fs_g, uint8_t odr, uint8_t lpf1, uint16_t lpf2)
{
    const struct lsm6dsx_settings settings = {gyro_fs_dps, accel_fs_g, odr, lpf1, lpf2};
    behaviour = ANSWERS;
    fine = stuck = turned = turned_bits = 0;
    turned_until_us = UINT32_MAX;
    now_us = transfers = logged = words_in = words_out = breaks_after = held_at = held_us = held_from_us = lost = wakes_us = longest_us = waits = 0;
    line_from_us = line_until_us = 0;
    byte_us = 2;
    overrun = busy_polls = pushed = shaken = ramp = line = 0;
    reset_registers();
    lsm6dsx_attach(&sensor, &BUS, &settings);
}

int possible(uint8_t chip, uint16_t gyro_fs_dps, uint16_t accel_fs_g, uint8_t odr, uint8_t lpf1, uint16_t lpf2)
{
    const struct lsm6dsx_settings settings = {gyro_fs_dps, accel_fs_g, odr, lpf1, lpf2};
    return lsm6dsx_possible(&settings, lsm6dsx_chip_of(chip));
}

int unsettled(uint8_t odr, uint8_t lpf1, uint16_t lpf2, int8_t freq_fine)
{
    const struct lsm6dsx_settings settings = {500, 4, odr, lpf1, lpf2};
    return lsm6dsx_unsettled(&settings, freq_fine);
}

int start(void)
{
    return (int)lsm6dsx_start(&sensor);
}

void push(const uint8_t *words, uint32_t count)
{
    for (uint32_t n = 0; n < count; n++)
        memcpy(bytes[words_in++ % MOST_WORDS], words + n * FIFO_WORD_BYTES, FIFO_WORD_BYTES);
}

/* Poll so often, a millisecond each; the samples, in all. */
unsigned poll(unsigned times, struct fifo_sample *out, unsigned most)
{
    struct fifo_sample some[FIFO_SAMPLES];
    unsigned count = 0;
    for (unsigned n = 0; n < times; n++) {
        const uint32_t began_us = now_us;
        const unsigned got = lsm6dsx_poll(&sensor, some);
        const uint32_t took_us = now_us - began_us;
        longest_us = took_us > longest_us ? took_us : longest_us;
        now_us += took_us < 1000 ? 1000 - took_us : 0;
        for (unsigned i = 0; i < got && count < most; i++)
            out[count++] = some[i];
    }
    return count;
}

const uint32_t *faults(void)
{
    return sensor.faults;
}

int running(void)
{
    return sensor.running;
}

int starting(void)
{
    return sensor.starting;
}

int has_settled(void)
{
    return sensor.fifo.settled;
}

void restart(uint16_t gyro_fs_dps, uint16_t accel_fs_g, uint8_t odr, uint8_t lpf1, uint16_t lpf2)
{
    sensor.settings = (struct lsm6dsx_settings){gyro_fs_dps, accel_fs_g, odr, lpf1, lpf2};
    lsm6dsx_restart(&sensor);
}

int freq_fine(void)
{
    return sensor.freq_fine;
}

void self_test(struct lsm6dsx_tested *tested)
{
    lsm6dsx_self_test(&sensor, tested);
}

/* The same by its steps, a millisecond each. */
void self_test_by_steps(struct lsm6dsx_tested *tested)
{
    struct lsm6dsx_self_test test;
    int goes_on;
    lsm6dsx_self_test_begin(&sensor, &test);
    do {
        const uint32_t began_us = now_us;
        goes_on = lsm6dsx_self_test_poll(&sensor, &test);
        longest_us = now_us - began_us > longest_us ? now_us - began_us : longest_us;
        now_us += 1000;
    } while (goes_on);
    *tested = test.tested;
}

/* The FIFO's words without a bus, each made at its time.  again: the sensor was started again before them; else all is forgotten first. */
static struct lsm6dsx_fifo fifo;

unsigned take_words(int again, uint8_t odr, int8_t freq_fine, uint16_t unsettled, const uint8_t *words, const uint32_t *made_us, uint32_t count,
                    uint32_t counts[FAULTS], struct fifo_sample *out)
{
    unsigned samples = 0;
    if (!again)
        fifo = (struct lsm6dsx_fifo){0};
    fifo_begin(&fifo, odr, freq_fine, unsettled);
    if (!again)
        fifo_temperature(&fifo, 0);
    for (uint32_t n = 0; n < count; n++)
        samples += (unsigned)fifo_take(&fifo, words + n * FIFO_WORD_BYTES, made_us[n], counts, out + samples);
    return samples;
}

int settled(void)
{
    return fifo.settled;
}

int bad_stamps(void)
{
    return fifo.bad_stamps;
}

/* The unique id of a chip, for identity.c. */
uint32_t unique_id[3];

uint32_t read_if_there(uint32_t address)
{
    return unique_id[(address - 0x1FFF7A10u) / 4];
}
