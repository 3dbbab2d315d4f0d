#include "small_imu.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WORDS = 438, WORD_BYTES = 7, ROWS_MOST = 1 << 16, MASK = 0x7FFF };
enum { GYRO = 1, ACCEL = 2, TEMPERATURE = 3, STAMP = 4 };
enum { FIFO_CTRL1 = 0x07, FIFO_CTRL3 = 0x09, FIFO_CTRL4 = 0x0A, WHO_AM_I = 0x0F, CTRL1_XL = 0x10, CTRL2_G = 0x11, CTRL3_C = 0x12 };
enum { CTRL4_C = 0x13, CTRL10_C = 0x19, STATUS = 0x1E, OUT_TEMP = 0x20, FIFO_STATUS1 = 0x3A, FREQ_FINE = 0x63, FIFO_OUT = 0x78 };

static const double TURN_ON_US = 70000, TICK_US = 25, PATIENCE_US = 4e6;
static const uint16_t TEMPERATURE_LSB = 512; /* 27 degC */

static struct {
    uint8_t who, fine, registers[128], fifo[WORDS][WORD_BYTES];
    int16_t rows[ROWS_MOST][6];
    long row_count, row, spoilt; /* of the input; the next one that is made; the one with a false parity */
    double ticks_per_period, answers_us, tick_us, on_us, slot_us, row_us; /* slot_us, row_us: when the last slot and row were made */
    int selected, begun, overrun;
    uint8_t address, place, count;
    unsigned first, words, slots;
} imu;

static void reset(void)
{
    memset(imu.registers, 0, sizeof imu.registers);
    imu.registers[WHO_AM_I] = imu.who;
    imu.registers[CTRL3_C] = 0x04;
    imu.registers[0x18] = 0xE0;
    imu.registers[FREQ_FINE] = imu.fine;
    imu.registers[OUT_TEMP] = (uint8_t)TEMPERATURE_LSB;
    imu.registers[OUT_TEMP + 1] = (uint8_t)(TEMPERATURE_LSB >> 8);
    imu.words = 0;
}

void imu_begin(char **words)
{
    imu.who = (uint8_t)atoi(words[0]);
    imu.fine = (uint8_t)atoi(words[1]);
    imu.ticks_per_period = atof(words[2]);
    imu.answers_us = 1e6 * atof(words[3]);
    imu.spoilt = atol(words[4]);
    imu.tick_us = TICK_US / (1 + 0.0015 * (int8_t)imu.fine);
    for (int value; imu.row_count < ROWS_MOST * 6L && scanf("%d", &value) == 1; imu.row_count++)
        imu.rows[imu.row_count / 6][imu.row_count % 6] = (int16_t)value;
    imu.row_count /= 6;
    reset();
}

int imu_goes_on(double now_us)
{
    return imu.row < imu.row_count && now_us < imu.row_us + PATIENCE_US;
}

static void push(uint8_t kind, const uint8_t bytes[6])
{
    if (imu.words == WORDS) {
        imu.first = (imu.first + 1) % WORDS;
        imu.words--;
        imu.overrun = 1;
    }
    uint8_t *word = imu.fifo[(imu.first + imu.words++) % WORDS];
    word[0] = (uint8_t)(kind << 3 | (imu.count & 3) << 1);
    word[0] |= (uint8_t)(__builtin_popcount(word[0]) & 1);
    word[0] ^= (uint8_t)(kind == ACCEL && imu.row == imu.spoilt);
    memcpy(word + 1, bytes, 6);
}

static void push_values(uint8_t kind, const int16_t values[3])
{
    uint8_t bytes[6];
    for (int n = 0; n < 3; n++) {
        bytes[2 * n] = (uint8_t)values[n];
        bytes[2 * n + 1] = (uint8_t)((uint16_t)values[n] >> 8);
    }
    push(kind, bytes);
}

/* The time slots up to now: both sensors at one rate, batched at it, with a stamp each and a temperature at 12.5 Hz. */
static void pass(double now_us)
{
    static const int16_t masked[3] = {MASK, MASK, MASK}, warmth[3] = {TEMPERATURE_LSB, 0, 0};
    const uint8_t *r = imu.registers;
    const int rate = r[CTRL1_XL] >> 4, runs = rate && r[CTRL2_G] >> 4 == rate;
    const int batched = runs && r[FIFO_CTRL3] == (rate << 4 | rate) && r[FIFO_CTRL4] == 0x66 && (r[CTRL10_C] & 0x20);
    if (!(r[FIFO_CTRL4] & 7))
        imu.words = 0;
    if (!runs) {
        imu.on_us = imu.slot_us = now_us;
        return;
    }
    const double period_us = ldexp(imu.ticks_per_period * imu.tick_us, 10 - rate);
    const double each = 80000 / period_us;
    for (; imu.slot_us + period_us <= now_us; imu.slots++) {
        imu.slot_us += period_us;
        if (!batched || imu.row == imu.row_count)
            continue;
        const int settled = !(r[CTRL4_C] & 8) || imu.slot_us - imu.on_us > TURN_ON_US;
        const uint32_t ticks = (uint32_t)(imu.slot_us / imu.tick_us);
        const uint8_t stamp[6] = {(uint8_t)ticks, (uint8_t)(ticks >> 8), (uint8_t)(ticks >> 16), (uint8_t)(ticks >> 24), 0, 0};
        imu.count++;
        push_values(GYRO, settled ? imu.rows[imu.row] : masked);
        push_values(ACCEL, settled ? imu.rows[imu.row] + 3 : masked);
        if (floor(imu.slots / each) != floor((imu.slots + 1) / each))
            push_values(TEMPERATURE, warmth);
        push(STAMP, stamp);
        imu.row += settled;
        imu.row_us = imu.slot_us;
    }
}

static void write_register(uint8_t address, uint8_t value)
{
    imu.registers[address] = value;
    if (address == CTRL3_C && (value & 1))
        reset();
}

static uint8_t read_register(uint8_t address)
{
    if (address == FIFO_STATUS1) {
        const unsigned full = imu.registers[FIFO_CTRL1] && imu.words >= imu.registers[FIFO_CTRL1];
        imu.registers[FIFO_STATUS1] = (uint8_t)imu.words;
        imu.registers[FIFO_STATUS1 + 1] = (uint8_t)(imu.words >> 8 | full << 7 | (unsigned)imu.overrun * 0x48);
        imu.overrun = 0;
    }
    if (address == STATUS)
        return 7;
    if (address < FIFO_OUT)
        return imu.registers[address];
    if (!imu.words)
        return 0;
    const uint8_t byte = imu.fifo[imu.first][imu.place++];
    if (imu.place == WORD_BYTES) {
        imu.place = 0;
        imu.first = (imu.first + 1) % WORDS;
        imu.words--;
    }
    return byte;
}

void imu_select(int selected)
{
    imu.selected = selected;
    imu.begun = 0;
    imu.place = 0;
}

uint8_t imu_exchange(uint8_t sent, double now_us)
{
    if (!imu.selected || now_us < imu.answers_us)
        return 0xFF; /* nobody drives the line, which is pulled up */
    pass(now_us);
    if (!imu.begun) {
        imu.begun = 1;
        imu.address = sent;
        return 0xFF;
    }
    if ((imu.address & 0x80) && sent != 0xFF)
        abort();
    const uint8_t address = imu.address & 0x7F;
    if (address < FIFO_OUT)
        imu.address++;
    if (imu.address & 0x80)
        return read_register(address);
    write_register(address, sent);
    return 0xFF;
}
