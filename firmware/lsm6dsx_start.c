/* From a sensor in whatever state to one whose registers are proved and whose FIFO runs, step by step. */
#include "lsm6dsx.h"
#include "lsm6dsx_registers.h"

static const uint32_t GYRO_OFF_US = 10000; /* before it may be switched on again; ST's own driver waits as long */
static const uint32_t RESET_US = 1000, RESET_MOST_US = 100000;
static const float TEMPERATURES_HZ = 12.5f; /* words of them in the FIFO; no sample comes before the first one */
static const uint32_t ON_US = 10000; /* before FREQ_FINE is read: it may be another one before the sensors are on */

void lsm6dsx_next(struct lsm6dsx *sensor, enum lsm6dsx_step step)
{
    sensor->step = step;
    sensor->step_us = sensor->bus->time();
}

enum fault lsm6dsx_identity_fault(uint8_t who)
{
    if (lsm6dsx_chip_of(who) != 0)
        return FAULTS;
    return (who == 0x00u) ? FAULT_ZEROS : ((who == 0xFFu) ? FAULT_ONES : FAULT_IDENTITY);
}

static enum fault identify(struct lsm6dsx *sensor)
{
    sensor->who = lsm6dsx_read_one(sensor, WHO_AM_I);
    if (sensor->failed)
        return FAULT_HANG;
    if (lsm6dsx_chip_of(sensor->who) != 0)
        sensor->chip = lsm6dsx_chip_of(sensor->who);
    return lsm6dsx_identity_fault(sensor->who);
}

/* Both sensors are off before the reset, as the family's application notes ask for. */
enum fault lsm6dsx_reset_step(struct lsm6dsx *sensor)
{
    const uint32_t passed_us = sensor->bus->time() - sensor->step_us;
    enum fault fault = FAULTS;
    sensor->failed = false;
    if (sensor->step == STEP_IDENTIFY) {
        fault = identify(sensor);
        if (fault == FAULTS) {
            lsm6dsx_write(sensor, CTRL1_XL, 0);
            lsm6dsx_write(sensor, CTRL2_G, 0);
            lsm6dsx_next(sensor, STEP_OFF);
        }
    } else if ((sensor->step == STEP_OFF) && (passed_us >= GYRO_OFF_US)) {
        lsm6dsx_write(sensor, CTRL3_C, SW_RESET | IF_INC);
        lsm6dsx_next(sensor, STEP_RESET);
    } else if ((sensor->step == STEP_RESET) && (passed_us >= RESET_US)) {
        if ((lsm6dsx_read_one(sensor, CTRL3_C) & SW_RESET) == 0) {
            fault = identify(sensor);
            lsm6dsx_next(sensor, STEP_BLANK);
        } else if (passed_us >= RESET_MOST_US) {
            fault = FAULT_RESET; /* which does not end */
        }
    }
    return sensor->failed ? FAULT_HANG : fault;
}

/* The FIFO, and the proof of all that was set.  FREQ_FINE is read on either side of the registers: a line that stuck the first time would
 * be in every stamp. */
static enum fault begin(struct lsm6dsx *sensor)
{
    uint8_t image[LSM6DSX_KEPT];
    sensor->failed = false;
    sensor->freq_fine = (int8_t)lsm6dsx_read_one(sensor, INTERNAL_FREQ_FINE);
    fifo_begin(&sensor->fifo, sensor->settings.odr, sensor->freq_fine, lsm6dsx_unsettled(&sensor->settings, sensor->freq_fine));
    const float words_hz = ((float)WORDS_PER_SLOT * fifo_rate_hz(sensor->settings.odr, sensor->freq_fine)) + TEMPERATURES_HZ;
    sensor->word_us = (uint32_t)(1e6f / words_hz);
    lsm6dsx_write(sensor, FIFO_CTRL4, CONTINUOUS);
    lsm6dsx_read(sensor, FIFO_CTRL1, sensor->kept, LSM6DSX_KEPT);
    const bool steady = lsm6dsx_read_one(sensor, INTERNAL_FREQ_FINE) == (uint8_t)sensor->freq_fine;
    if (sensor->failed)
        return FAULT_HANG;
    sensor->who = sensor->kept[LSM6DSX_KEPT_WHO];
    lsm6dsx_image(sensor, image);
    const enum fault fault = lsm6dsx_identity_fault(sensor->who);
    const bool taken = steady && lsm6dsx_alike(sensor->chip->known, image, sensor->kept, LSM6DSX_KEPT);
    return ((fault == FAULTS) && !taken) ? FAULT_CHANGED : fault;
}

enum fault lsm6dsx_start_step(struct lsm6dsx *sensor)
{
    const uint32_t passed_us = sensor->bus->time() - sensor->step_us;
    enum fault fault = FAULTS;
    if ((sensor->step == STEP_IDENTIFY) && !lsm6dsx_possible(&sensor->settings, 0)) {
        fault = LSM6DSX_IMPOSSIBLE;
    } else if (sensor->step < STEP_BLANK) {
        fault = lsm6dsx_reset_step(sensor);
    } else if (sensor->step == STEP_BLANK) {
        if (!lsm6dsx_possible(&sensor->settings, sensor->chip))
            return (sensor->found && !sensor->starting) ? FAULT_IDENTITY : LSM6DSX_IMPOSSIBLE; /* another chip than the one that ran */
        sensor->failed = false;
        lsm6dsx_write_settings(sensor);
        fault = sensor->failed ? FAULT_HANG : FAULTS;
        lsm6dsx_next(sensor, STEP_ON);
    } else if (passed_us >= ON_US) {
        fault = begin(sensor);
        lsm6dsx_next(sensor, STEP_RUNS);
    }
    return fault;
}
