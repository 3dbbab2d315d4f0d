/* Procedure and limits are those by which ST's own Linux driver judges an ASM330LHH (st_asm330lhh, public): mean of five outputs without
 * and with the force, each 0.1 s behind the switch; 2142 to 10000 LSB at 2000 dps, 737 to 13934 LSB at 4 g.  Nobody here has read them in
 * Table 3 of the data sheet (DocID031239): look there before a part is thrown away for them. */
#include "lsm6dsx_self_test.h"

#include "lsm6dsx_registers.h"

enum {
    GYRO_208HZ_2000DPS = 5 << 4 | 12,
    ACCEL_52HZ_4G = 3 << 4 | 2 << 2,
    SWITCH_US = 100000,
    OUTPUTS = 5,
    OUTPUT_MOST_MS = 100, /* until the next output; 20 at 52 Hz */
    NOTHING_MEASURED = 0x8000,
};

static const float GYRO_DPS_PER_LSB = 0.070f, GYRO_LEAST_LSB = 2142.0f, GYRO_MOST_LSB = 10000.0f; /* 150, 700 dps */
static const float ACCEL_MG_PER_LSB = 0.122f, ACCEL_LEAST_LSB = 737.0f, ACCEL_MOST_LSB = 13934.0f; /* 90, 1700 mg */

/* Add up outputs; 0 where they do not come.  The first one is dropped: it may be of before the switch. */
static int add_up(struct lsm6dsx *sensor, uint8_t ready, uint8_t address, int32_t sum[3])
{
    uint8_t bytes[6];
    for (int n = 0; n <= OUTPUTS; n++) {
        int ms = 0;
        while (!(lsm6dsx_read_one(sensor, STATUS_REG) & ready)) {
            if (sensor->failed || ms++ == OUTPUT_MOST_MS)
                return 0;
            sensor->bus->wait(1000);
        }
        lsm6dsx_read(sensor, address, bytes, 6);
        for (int i = 0; i < 3 && n > 0; i++)
            sum[i] += (int16_t)(uint16_t)(bytes[2 * i] | bytes[2 * i + 1] << 8);
    }
    return !sensor->failed;
}

/* Change of the output in LSB when the force of CTRL5_C is switched on. */
static int change(struct lsm6dsx *sensor, uint8_t force, uint8_t ready, uint8_t address, float lsb[3])
{
    int32_t off[3] = {0, 0, 0}, on[3] = {0, 0, 0};
    sensor->bus->wait(SWITCH_US);
    int measured = add_up(sensor, ready, address, off);
    lsm6dsx_write(sensor, CTRL5_C, force);
    sensor->bus->wait(SWITCH_US);
    measured = measured && add_up(sensor, ready, address, on);
    lsm6dsx_write(sensor, CTRL5_C, 0);
    for (int i = 0; i < 3; i++)
        lsb[i] = (float)(on[i] - off[i]) / (float)OUTPUTS;
    return measured;
}

static int within(float value, float least, float most)
{
    const float size = value < 0.0f ? -value : value;
    return size >= least && size <= most;
}

void lsm6dsx_self_test(struct lsm6dsx *sensor, struct lsm6dsx_tested *tested)
{
    *tested = (struct lsm6dsx_tested){.failed = NOTHING_MEASURED};
    sensor->running = 0;
    if (lsm6dsx_reset(sensor) != FAULTS)
        return;
    lsm6dsx_write(sensor, CTRL3_C, BDU | IF_INC);
    lsm6dsx_write(sensor, CTRL9_XL, lsm6dsx_read_one(sensor, CTRL9_XL) | DEVICE_CONF);
    lsm6dsx_write(sensor, CTRL2_G, GYRO_208HZ_2000DPS);
    const int turned = change(sensor, ST_G_POSITIVE, GDA, OUTX_L_G, tested->gyro_dps);
    lsm6dsx_write(sensor, CTRL2_G, 0);
    lsm6dsx_write(sensor, CTRL1_XL, ACCEL_52HZ_4G);
    const int pushed = change(sensor, ST_XL_POSITIVE, XLDA, OUTX_L_A, tested->accel_mg);
    lsm6dsx_write(sensor, CTRL1_XL, 0);
    if (!turned || !pushed)
        return;
    tested->failed = 0;
    for (int i = 0; i < 3; i++) {
        if (!within(tested->gyro_dps[i], GYRO_LEAST_LSB, GYRO_MOST_LSB))
            tested->failed |= (uint16_t)(1 << i);
        if (!within(tested->accel_mg[i], ACCEL_LEAST_LSB, ACCEL_MOST_LSB))
            tested->failed |= (uint16_t)(1 << (3 + i));
        tested->gyro_dps[i] *= GYRO_DPS_PER_LSB;
        tested->accel_mg[i] *= ACCEL_MG_PER_LSB;
    }
}
