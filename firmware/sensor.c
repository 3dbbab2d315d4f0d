#include "sensor.h"

#include "board.h"
#include "board_spi.h"
#include "defaults.h"
#include "stream.h"

/* A sensor may take its time after power-up.  Later it is not looked for: one that is plugged in then is fed through its data lines. */
enum { LOOK_MS = 2000 };

/* Any chip has these: if the model is of another sensor than this. */
static const struct lsm6dsx_settings FALLBACK = {500, 4, 6, LPF1_OFF, 2};

static const struct lsm6dsx_bus BUS = {board_spi_transfer, board_spi_select, board_wait_us, board_microseconds};

static struct lsm6dsx sensor;
static struct lsm6dsx_self_test self_test;
static struct lsm6dsx_settings before; /* of the start that was asked for last */
static enum fault outcome = FAULTS;
static bool looking, setting, testing;

void sensor_start(void)
{
    const struct lsm6dsx_settings settings = {GYRO_FS_DPS, ACCEL_FS_G, lsm6dsx_odr((float)ODR_HZ), LPF1_OFF, 2};
    before = FALLBACK;
    looking = true;
    setting = true;
    board_spi_start();
    lsm6dsx_attach(&sensor, &BUS, &settings);
}

bool sensor_found(void)
{
    return sensor.found;
}

bool sensor_busy(void)
{
    return looking || testing || sensor.starting;
}

const struct lsm6dsx *sensor_state(void)
{
    return &sensor;
}

float sensor_rate_hz(void)
{
    return fifo_rate_hz(sensor.settings.odr, sensor.freq_fine);
}

/* A start that was asked for has ended; but a sensor that is looked for may still come, and is then set as it was to be. */
static void end_of_start(void)
{
    outcome = sensor.reason;
    if (looking && !sensor.found && (outcome != LSM6DSX_IMPOSSIBLE))
        return;
    setting = false;
    if ((outcome == LSM6DSX_IMPOSSIBLE) || !sensor.found)
        sensor.settings = lsm6dsx_possible(&before, sensor.chip) ? before : FALLBACK;
    if (outcome == LSM6DSX_IMPOSSIBLE)
        lsm6dsx_restart(&sensor);
}

static void test_on(void)
{
    if (lsm6dsx_self_test_poll(&sensor, &self_test))
        return;
    testing = false;
    lsm6dsx_restart(&sensor);
}

bool sensor_stream(void)
{
    static struct fifo_sample samples[FIFO_SAMPLES];
    static uint32_t polled_ms, number;
    static bool more;
    const uint32_t now_ms = board_milliseconds();
    if ((!sensor.found && !sensor_busy()) || (!more && (sensor.burst == 0u) && (now_ms == polled_ms)))
        return false;
    polled_ms = now_ms;
    more = false;
    if (testing) {
        test_on();
        return false;
    }
    const unsigned count = lsm6dsx_poll(&sensor, samples);
    for (unsigned n = 0; n < count; n++) {
        stream_sample(samples[n].number - number, samples[n].t_us, samples[n].registers);
        number = samples[n].number;
    }
    more = count > 0u;
    if (setting && !sensor.starting)
        end_of_start();
    looking = looking && !sensor.found && (now_ms < LOOK_MS);
    return more;
}

void sensor_set(const struct lsm6dsx_settings *settings)
{
    before = sensor.settings;
    setting = true;
    sensor.settings = *settings;
    lsm6dsx_restart(&sensor);
}

enum fault sensor_outcome(void)
{
    return outcome;
}

void sensor_test(void)
{
    testing = true;
    lsm6dsx_self_test_begin(&sensor, &self_test);
}

const struct lsm6dsx_tested *sensor_tested(void)
{
    return &self_test.tested;
}
