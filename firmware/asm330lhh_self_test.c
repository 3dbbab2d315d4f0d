/* The procedure of ST's family, as its application notes have it: mean of five outputs without and with the force, each 0.1 s behind the
 * switch.  The limits are remembered from the family's data sheets, and not read in the ASM330LHH's own: check them against Table 3 of
 * DocID031239 before a part is thrown away for them. */
#include "asm330lhh_self_test.h"

#include "asm330lhh_registers.h"

enum {
    GYRO_208HZ_2000DPS = 5 << 4 | 12,
    ACCEL_52HZ_4G = 3 << 4 | 2 << 2,
    SWITCH_US = 100000,
    OUTPUTS = 5,
    OUTPUT_MOST_MS = 100, /* until the next output; 20 at 52 Hz */
    NOTHING_MEASURED = 0x8000,
};

static const float GYRO_DPS_PER_LSB = 0.070f, GYRO_LEAST_DPS = 150.0f, GYRO_MOST_DPS = 700.0f;
static const float ACCEL_MG_PER_LSB = 0.122f, ACCEL_LEAST_MG = 40.0f, ACCEL_MOST_MG = 1700.0f;

/* Add up outputs; 0 where they do not come.  The first one is dropped: it may be of before the switch. */
static int add_up(struct asm330lhh *sensor, uint8_t ready, uint8_t address, int32_t sum[3])
{
    uint8_t bytes[6];
    for (int n = 0; n <= OUTPUTS; n++) {
        int ms = 0;
        while (!(asm330lhh_read_one(sensor, STATUS_REG) & ready)) {
            if (sensor->failed || ms++ == OUTPUT_MOST_MS)
                return 0;
            sensor->bus->wait(1000);
        }
        asm330lhh_read(sensor, address, bytes, 6);
        for (int i = 0; i < 3 && n > 0; i++)
            sum[i] += (int16_t)(uint16_t)(bytes[2 * i] | bytes[2 * i + 1] << 8);
    }
    return !sensor->failed;
}

/* Change of the output in LSB when the force of CTRL5_C is switched on. */
static int change(struct asm330lhh *sensor, uint8_t force, uint8_t ready, uint8_t address, float lsb[3])
{
    int32_t off[3] = {0, 0, 0}, on[3] = {0, 0, 0};
    sensor->bus->wait(SWITCH_US);
    int measured = add_up(sensor, ready, address, off);
    asm330lhh_write(sensor, CTRL5_C, force);
    sensor->bus->wait(SWITCH_US);
    measured = measured && add_up(sensor, ready, address, on);
    asm330lhh_write(sensor, CTRL5_C, 0);
    for (int i = 0; i < 3; i++)
        lsb[i] = (float)(on[i] - off[i]) / (float)OUTPUTS;
    return measured;
}

static int within(float value, float least, float most)
{
    const float size = value < 0.0f ? -value : value;
    return size >= least && size <= most;
}

void asm330lhh_self_test(struct asm330lhh *sensor, struct asm330lhh_tested *tested)
{
    *tested = (struct asm330lhh_tested){.failed = NOTHING_MEASURED};
    sensor->running = 0;
    if (asm330lhh_reset(sensor) != FAULTS)
        return;
    asm330lhh_write(sensor, CTRL3_C, BDU | IF_INC);
    asm330lhh_write(sensor, CTRL2_G, GYRO_208HZ_2000DPS);
    const int turned = change(sensor, ST_G_POSITIVE, GDA, OUTX_L_G, tested->gyro_dps);
    asm330lhh_write(sensor, CTRL2_G, 0);
    asm330lhh_write(sensor, CTRL1_XL, ACCEL_52HZ_4G);
    const int pushed = change(sensor, ST_XL_POSITIVE, XLDA, OUTX_L_A, tested->accel_mg);
    asm330lhh_write(sensor, CTRL1_XL, 0);
    if (!turned || !pushed)
        return;
    tested->failed = 0;
    for (int i = 0; i < 3; i++) {
        tested->gyro_dps[i] *= GYRO_DPS_PER_LSB;
        tested->accel_mg[i] *= ACCEL_MG_PER_LSB;
        if (!within(tested->gyro_dps[i], GYRO_LEAST_DPS, GYRO_MOST_DPS))
            tested->failed |= (uint16_t)(1 << i);
        if (!within(tested->accel_mg[i], ACCEL_LEAST_MG, ACCEL_MOST_MG))
            tested->failed |= (uint16_t)(1 << (3 + i));
    }
}
