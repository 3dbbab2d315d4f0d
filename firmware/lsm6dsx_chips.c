/* Sources: ST's headers asm330lhh_reg.h and lsm6dso_reg.h for codes and bits, ST's Linux drivers st_asm330lhh and st_lsm6dsox for the
 * limits of the self-test.  They were not read in a data sheet: look there before a part is thrown away for them. */
#include "lsm6dsx_chips.h"

#include "lsm6dsx_registers.h"

/* Places of registers in set and known. */
enum {
    OF_FIFO_CTRL1 = FIFO_CTRL1 - FIFO_CTRL1,
    OF_FIFO_CTRL2 = FIFO_CTRL2 - FIFO_CTRL1,
    OF_FIFO_CTRL3 = FIFO_CTRL3 - FIFO_CTRL1,
    OF_FIFO_CTRL4 = FIFO_CTRL4 - FIFO_CTRL1,
    OF_COUNTER_BDR_REG1 = COUNTER_BDR_REG1 - FIFO_CTRL1,
    OF_COUNTER_BDR_REG2 = COUNTER_BDR_REG2 - FIFO_CTRL1,
    OF_INT1_CTRL = INT1_CTRL - FIFO_CTRL1,
    OF_INT2_CTRL = INT2_CTRL - FIFO_CTRL1,
    OF_WHO_AM_I = WHO_AM_I - FIFO_CTRL1,
    OF_CTRL1_XL = CTRL1_XL - FIFO_CTRL1,
    OF_CTRL2_G = CTRL2_G - FIFO_CTRL1,
    OF_CTRL3_C = CTRL3_C - FIFO_CTRL1,
    OF_CTRL4_C = CTRL4_C - FIFO_CTRL1,
    OF_CTRL5_C = CTRL5_C - FIFO_CTRL1,
    OF_CTRL6_C = CTRL6_C - FIFO_CTRL1,
    OF_CTRL7_G = CTRL7_G - FIFO_CTRL1,
    OF_CTRL8_XL = CTRL8_XL - FIFO_CTRL1,
    OF_CTRL9_XL = CTRL9_XL - FIFO_CTRL1,
    OF_CTRL10_C = CTRL10_C - FIFO_CTRL1,
};

/* What every chip is given. */
#define ALWAYS_SET                                                                                                                         \
    [OF_FIFO_CTRL4] = CONTINUOUS, [OF_INT1_CTRL] = INT1_FIFO_TH, [OF_CTRL3_C] = BDU | IF_INC, [OF_CTRL4_C] = I2C_DISABLE | DRDY_MASK,      \
    [OF_CTRL10_C] = TIMESTAMP_EN

/* What means the same in every chip; COUNTER_BDR_REG1 without the bit that clears itself. */
#define ALWAYS_KNOWN                                                                                                                       \
    [OF_FIFO_CTRL1] = 0xFF, [OF_FIFO_CTRL3] = 0xFF, [OF_FIFO_CTRL4] = 0xF7, [OF_COUNTER_BDR_REG2] = 0xFF, [OF_INT1_CTRL] = 0xFF,           \
    [OF_INT2_CTRL] = 0xFF, [OF_WHO_AM_I] = 0xFF, [OF_CTRL1_XL] = 0xFE, [OF_CTRL3_C] = 0xFD, [OF_CTRL4_C] = 0x6E, [OF_CTRL9_XL] = 0xFE,     \
    [OF_CTRL10_C] = 0x20

static const struct lsm6dsx_code UP_TO_16_G[] = {{2, 0}, {16, 1}, {4, 2}, {8, 3}, {0, 0}};
static const struct lsm6dsx_code UP_TO_4000_DPS[] = {{125, 2}, {250, 0}, {500, 4}, {1000, 8}, {2000, 12}, {4000, 1}, {0, 0}};
static const struct lsm6dsx_code UP_TO_2000_DPS[] = {{125, 2}, {250, 0}, {500, 4}, {1000, 8}, {2000, 12}, {0, 0}};

static const struct lsm6dsx_chip CHIPS[] = {
    {
        /* The same WHO_AM_I have the ASM330LHHX, ASM330LHHXG1, ASM330LHB, ISM330DHCX, LSM6DSR and LSM6DSRX: it does not name one. */
        .name = "ASM330LHH",
        .who = 0x6B,
        .gyro_fs_dps = UP_TO_4000_DPS,
        .accel_fs_g = UP_TO_16_G,
        .set = {ALWAYS_SET, [OF_WHO_AM_I] = 0x6B, [OF_CTRL9_XL] = DEN_XYZ | DEVICE_CONF},
        .known = {ALWAYS_KNOWN, [OF_FIFO_CTRL2] = 0x91, [OF_COUNTER_BDR_REG1] = 0xA3, [OF_CTRL2_G] = 0xFF, [OF_CTRL5_C] = 0x6F,
                  [OF_CTRL6_C] = 0xEF, [OF_CTRL7_G] = 0x72, [OF_CTRL8_XL] = 0xFD},
        .gyro_force = {2142.0f, 10000.0f, 0.070f},
        .accel_force = {737.0f, 13934.0f, 0.122f},
    },
    {
        /* No 4000 dps; compression of the FIFO, low power and the second interface have bits of their own, which all stay 0. */
        .name = "LSM6DSO",
        .who = 0x6C,
        .gyro_fs_dps = UP_TO_2000_DPS,
        .accel_fs_g = UP_TO_16_G,
        .set = {ALWAYS_SET, [OF_WHO_AM_I] = 0x6C, [OF_CTRL9_XL] = DEN_XYZ | I3C_DISABLE},
        .known = {ALWAYS_KNOWN, [OF_FIFO_CTRL2] = 0xD7, [OF_COUNTER_BDR_REG1] = 0xA7, [OF_CTRL2_G] = 0xFE, [OF_CTRL5_C] = 0xEF,
                  [OF_CTRL6_C] = 0xFF, [OF_CTRL7_G] = 0xF7, [OF_CTRL8_XL] = 0xFF},
        .gyro_force = {2142.0f, 10000.0f, 0.070f},
        .accel_force = {737.0f, 13934.0f, 0.122f},
    },
};

const struct lsm6dsx_chip *lsm6dsx_chip_of(uint8_t who)
{
    for (unsigned n = 0; n < sizeof CHIPS / sizeof CHIPS[0]; n++) {
        if (CHIPS[n].who == who)
            return &CHIPS[n];
    }
    return 0;
}
