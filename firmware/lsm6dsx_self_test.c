/* The procedure is the one by which the Linux drivers of ST test the family: the mean of five outputs without and with the force, each
 * 0.1 s behind the switch, 0.15 s behind a reset.  It is measured without the force once more behind it: the change is against the mean of
 * both, and where they differ the part has turned meanwhile.  The limits are in lsm6dsx_chips.c.
 *
 * A part fails for what was measured, never for a bus: each output comes in one burst with WHO_AM_I and the control registers, which must
 * be as they were set, and WHO_AM_I follows it once more.  Five outputs of a sensor that lies still are alike. */
#include "lsm6dsx_self_test.h"

#include "lsm6dsx_registers.h"

enum {
    GYRO_208HZ_2000DPS = (5u << 4) | 12u,
    ACCEL_52HZ_4G = (3u << 4) | (2u << 2),
    OUTPUTS = 5,
    STAGES = 3, /* of a part: without the force, with it, without it */
    PHASES = 2 * STAGES,
    ALIKE_SHARE = 8, /* of the least that the force must do: what the outputs of a phase may differ by, and the phases without the force */
    BURST = OUTX_L_A + 6 - WHO_AM_I,
};

static const uint16_t NOTHING_MEASURED = 0x8000;
static const uint32_t BLANK_US = 150000, SWITCH_US = 100000;
static const uint32_t OUTPUT_MOST_US = 100000; /* until the next output; 20 ms at 52 Hz */

static bool is_gyro(const struct lsm6dsx_self_test *test)
{
    return test->phase < (uint8_t)STAGES;
}

/* The registers of the phase, as lsm6dsx_image has them. */
static void image_of(const struct lsm6dsx *sensor, const struct lsm6dsx_self_test *test, uint8_t image[LSM6DSX_KEPT])
{
    const bool pushed = (test->phase % (uint8_t)STAGES) == 1u;
    for (unsigned n = 0; n < LSM6DSX_KEPT; n++)
        image[n] = 0;
    image[WHO_AM_I - FIFO_CTRL1] = sensor->chip->who;
    image[CTRL3_C - FIFO_CTRL1] = BDU | IF_INC;
    image[CTRL9_XL - FIFO_CTRL1] = sensor->chip->set[CTRL9_XL - FIFO_CTRL1];
    image[(is_gyro(test) ? CTRL2_G : CTRL1_XL) - FIFO_CTRL1] = is_gyro(test) ? GYRO_208HZ_2000DPS : ACCEL_52HZ_4G;
    if (pushed)
        image[CTRL5_C - FIFO_CTRL1] = is_gyro(test) ? ST_G_POSITIVE : ST_XL_POSITIVE;
}

static void begin_phase(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test, uint8_t phase)
{
    static const uint8_t ORDER[] = {CTRL3_C, CTRL9_XL, CTRL5_C, CTRL1_XL, CTRL2_G};
    uint8_t image[LSM6DSX_KEPT];
    test->phase = phase;
    test->taken = 0;
    image_of(sensor, test, image);
    for (unsigned n = 0; n < sizeof ORDER; n++)
        lsm6dsx_write(sensor, ORDER[n], image[ORDER[n] - FIFO_CTRL1]);
    test->since_us = sensor->bus->time();
}

/* Take an output, if there is a new one; false where the registers are not those of the phase.  The first one is dropped: it may be of
 * before the switch. */
static bool take_output(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test)
{
    uint8_t image[LSM6DSX_KEPT], bytes[BURST];
    const uint8_t *output = &bytes[(is_gyro(test) ? OUTX_L_G : OUTX_L_A) - WHO_AM_I];
    image_of(sensor, test, image);
    lsm6dsx_read(sensor, WHO_AM_I, bytes, BURST);
    const uint8_t *known = &sensor->chip->known[LSM6DSX_KEPT_WHO];
    const bool sure = (lsm6dsx_read_one(sensor, WHO_AM_I) == sensor->chip->who) &&
                      lsm6dsx_alike(known, &image[LSM6DSX_KEPT_WHO], bytes, LSM6DSX_KEPT - LSM6DSX_KEPT_WHO);
    if ((bytes[STATUS_REG - WHO_AM_I] & (is_gyro(test) ? GDA : XLDA)) == 0)
        return sure && ((sensor->bus->time() - test->since_us) < (((test->taken == 0u) ? SWITCH_US : 0u) + OUTPUT_MOST_US));
    for (int i = 0; (i < 3) && (test->taken > 0u); i++) {
        const int16_t value = (int16_t)(uint16_t)(output[2 * i] | ((uint16_t)output[(2 * i) + 1] << 8));
        test->sum[test->phase % (uint8_t)STAGES][i] += value;
        test->least[i] = ((test->taken == 1u) || (value < test->least[i])) ? value : test->least[i];
        test->most[i] = ((test->taken == 1u) || (value > test->most[i])) ? value : test->most[i];
    }
    test->taken++;
    test->since_us = sensor->bus->time();
    return sure;
}

/* Five outputs are there: whether they are alike, and behind the last stage whether the first one's were like them. */
static bool lay_still(const struct lsm6dsx_self_test *test, const struct lsm6dsx_force *force)
{
    const float most_lsb = force->least_lsb / (float)ALIKE_SHARE;
    const bool last = (test->phase % (uint8_t)STAGES) == 2u;
    bool still = true;
    for (int i = 0; i < 3; i++) {
        const float moved = (float)(test->sum[2][i] - test->sum[0][i]) / (float)OUTPUTS;
        still = still && (((float)test->most[i] - (float)test->least[i]) <= most_lsb);
        still = still && (!last || (((moved < 0.0f) ? -moved : moved) <= most_lsb));
    }
    return still;
}

/* The stages of a part are over: how far the force has moved it, and the axes that it has not moved as it should. */
static uint16_t evaluate(struct lsm6dsx_self_test *test, const struct lsm6dsx_force *force, float moved[3])
{
    uint16_t failed = 0;
    for (unsigned i = 0; i < 3u; i++) {
        const float lsb = ((float)test->sum[1][i] - (0.5f * (float)(test->sum[0][i] + test->sum[2][i]))) / (float)OUTPUTS;
        const float size = (lsb < 0.0f) ? -lsb : lsb;
        if ((size < force->least_lsb) || (size > force->most_lsb))
            failed |= (uint16_t)(1u << i);
        moved[i] = lsb * force->unit;
        for (unsigned stage = 0; stage < (unsigned)STAGES; stage++)
            test->sum[stage][i] = 0;
    }
    return failed;
}

/* Both parts off; whether the result counts. */
static void end(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test, bool measured)
{
    static const uint8_t OFF[] = {CTRL5_C, CTRL1_XL, CTRL2_G};
    sensor->failed = false;
    for (unsigned n = 0; (n < sizeof OFF) && (sensor->chip != 0); n++)
        lsm6dsx_write(sensor, OFF[n], 0);
    if (!measured)
        test->tested = (struct lsm6dsx_tested){.failed = NOTHING_MEASURED};
    test->done = true;
    sensor->step = STEP_STANDS;
    sensor->tried_us = sensor->bus->time();
    sensor->again_us = 0;
}

void lsm6dsx_self_test_begin(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test)
{
    lsm6dsx_restart(sensor);
    sensor->starting = false;
    *test = (struct lsm6dsx_self_test){0};
}

/* The sensor is as a reset leaves it: the phases, one after the other. */
static void measure(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test)
{
    const struct lsm6dsx_force *force = is_gyro(test) ? &sensor->chip->gyro_force : &sensor->chip->accel_force;
    sensor->failed = false;
    if ((test->taken == 0u) && ((sensor->bus->time() - test->since_us) < SWITCH_US))
        return;
    if (!take_output(sensor, test) || sensor->failed) {
        end(sensor, test, false);
    } else if (test->taken > OUTPUTS) {
        const bool still = lay_still(test, force);
        if ((test->phase % (uint8_t)STAGES) == 2u) {
            const uint16_t failed = evaluate(test, force, is_gyro(test) ? test->tested.gyro_dps : test->tested.accel_mg);
            test->tested.failed |= (uint16_t)(is_gyro(test) ? failed : (failed << 3));
        }
        if (!still || (test->phase == PHASES - 1))
            end(sensor, test, still);
        else
            begin_phase(sensor, test, (uint8_t)(test->phase + 1u));
    }
}

bool lsm6dsx_self_test_poll(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test)
{
    if (test->done || !lsm6dsx_bus_is_free(sensor))
        return !test->done;
    if (sensor->step < STEP_BLANK) {
        if (lsm6dsx_reset_step(sensor) != FAULTS)
            end(sensor, test, false);
    } else if (sensor->step == STEP_BLANK) {
        if ((sensor->bus->time() - sensor->step_us) >= BLANK_US) {
            sensor->failed = false;
            begin_phase(sensor, test, 0);
            lsm6dsx_next(sensor, STEP_ON);
        }
    } else {
        measure(sensor, test);
    }
    return !test->done;
}

void lsm6dsx_self_test(struct lsm6dsx *sensor, struct lsm6dsx_tested *tested)
{
    struct lsm6dsx_self_test test;
    lsm6dsx_self_test_begin(sensor, &test);
    while (lsm6dsx_self_test_poll(sensor, &test))
        sensor->bus->wait(1000);
    *tested = test.tested;
}
