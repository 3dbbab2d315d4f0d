/* From a sensor in whatever state to one whose registers are proved and whose FIFO runs, step by step. */
#include "lsm6dsx.h"
#include "lsm6dsx_registers.h"

static const uint32_t GYRO_OFF_US = 10000; /* before it may be switched on again; ST's own driver waits as long */
static const uint32_t RESET_US = 1000, RESET_MOST_US = 100000;
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
    if ((lsm6dsx_read_one(sensor, STATUS_REG) & TDA) != 0) {
        uint8_t temperature[2];
        lsm6dsx_read(sensor, OUT_TEMP_L, temperature, 2);
        fifo_temperature(&sensor->fifo, (int16_t)(uint16_t)(temperature[0] | ((uint16_t)temperature[1] << 8)));
    } /* else there is no sample before the first temperature comes through the FIFO */
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
            return LSM6DSX_IMPOSSIBLE;
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
