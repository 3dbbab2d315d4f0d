#include "sensor.h"

#include "board.h"
#include "board_spi.h"
#include "defaults.h"
#include "stream.h"

#ifdef RECORDER
/* What make was given.  With others the sensor would not start, and be set to 417 Hz, 500 dps, 4 g; a model's may be of another sensor. */
#define IS_RATE(hz)                                                                                                                        \
    (((hz) == 12.0) || ((hz) == 12.5) || ((hz) == 26.0) || ((hz) == 52.0) || ((hz) == 104.0) || ((hz) == 208.0) || ((hz) == 417.0) ||      \
     ((hz) == 833.0) || ((hz) == 1667.0) || ((hz) == 3333.0) || ((hz) == 6667.0))
#define IS_DPS(fs) (((fs) == 125) || ((fs) == 250) || ((fs) == 500) || ((fs) == 1000) || ((fs) == 2000) || ((fs) == 4000))
#define IS_G(fs) (((fs) == 2) || ((fs) == 4) || ((fs) == 8) || ((fs) == 16))
_Static_assert(IS_RATE((double)ODR_HZ), "ODR_HZ is one of 12.5 (or 12), 26, 52, 104, 208, 417, 833, 1667, 3333, 6667");
_Static_assert(IS_DPS(GYRO_FS_DPS), "GYRO_FS_DPS is one of 125, 250, 500, 1000, 2000, 4000");
_Static_assert(IS_G(ACCEL_FS_G), "ACCEL_FS_G is one of 2, 4, 8, 16");
#endif

/* A sensor may take its time after power-up.  Later it is not looked for: one that is plugged in then is fed through its data lines. */
enum { LOOK_MS = 2000 };

/* Any chip has these: if the model is of another sensor than this. */
static const struct lsm6dsx_settings FALLBACK = {500, 4, 6, LPF1_OFF, 2};

static const struct lsm6dsx_bus BUS = {board_spi_transfer, board_spi_select, board_wait_us, board_microseconds};

static struct lsm6dsx sensor;
static struct lsm6dsx_self_test self_test;
static struct lsm6dsx_settings before; /* of the last requested start */
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

/* A requested start has ended; but a sensor that is looked for may still come, and is then set as it was to be. */
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
