/* Sources: ST's headers asm330lhh_reg.h and lsm6dso_reg.h for codes and bits, ST's Linux drivers st_asm330lhh and st_lsm6dsox for the
 * limits of the self-test.  Nobody here has read them in a data sheet: look there before a part is thrown away for them. */
#include "lsm6dsx_chips.h"

#include "lsm6dsx_registers.h"

#define KEPT(address) [(address) - FIFO_CTRL1]

/* What every chip is given. */
#define ALWAYS_SET                                                                                                               \
    KEPT(FIFO_CTRL4) = CONTINUOUS, KEPT(INT1_CTRL) = INT1_FIFO_TH, KEPT(CTRL3_C) = BDU | IF_INC, KEPT(CTRL4_C) = I2C_DISABLE | DRDY_MASK, \
    KEPT(CTRL10_C) = TIMESTAMP_EN

/* What means the same in every chip; COUNTER_BDR_REG1 without the bit that clears itself. */
#define ALWAYS_KNOWN                                                                                                                   \
    KEPT(FIFO_CTRL1) = 0xFF, KEPT(FIFO_CTRL3) = 0xFF, KEPT(FIFO_CTRL4) = 0xF7, KEPT(COUNTER_BDR_REG2) = 0xFF, KEPT(INT1_CTRL) = 0xFF,  \
    KEPT(INT2_CTRL) = 0xFF, KEPT(WHO_AM_I) = 0xFF, KEPT(CTRL1_XL) = 0xFE, KEPT(CTRL3_C) = 0xFD, KEPT(CTRL4_C) = 0x6E,                  \
    KEPT(CTRL9_XL) = 0xFE, KEPT(CTRL10_C) = 0x20

static const struct lsm6dsx_code ACCEL_FS_G[] = {{2, 0}, {16, 1}, {4, 2}, {8, 3}, {0, 0}};
static const struct lsm6dsx_code UP_TO_4000_DPS[] = {{125, 2}, {250, 0}, {500, 4}, {1000, 8}, {2000, 12}, {4000, 1}, {0, 0}};
static const struct lsm6dsx_code UP_TO_2000_DPS[] = {{125, 2}, {250, 0}, {500, 4}, {1000, 8}, {2000, 12}, {0, 0}};

static const struct lsm6dsx_chip CHIPS[] = {
    {
        /* The same WHO_AM_I have the ASM330LHHX, ASM330LHHXG1, ASM330LHB, ISM330DHCX, LSM6DSR and LSM6DSRX: it does not say who. */
        .name = "ASM330LHH",
        .who = 0x6B,
        .gyro_fs_dps = UP_TO_4000_DPS,
        .accel_fs_g = ACCEL_FS_G,
        .set = {ALWAYS_SET, KEPT(WHO_AM_I) = 0x6B, KEPT(CTRL9_XL) = DEN_XYZ | DEVICE_CONF},
        .known = {ALWAYS_KNOWN, KEPT(FIFO_CTRL2) = 0x91, KEPT(COUNTER_BDR_REG1) = 0xA3, KEPT(CTRL2_G) = 0xFF, KEPT(CTRL5_C) = 0x6F,
                  KEPT(CTRL6_C) = 0xEF, KEPT(CTRL7_G) = 0x72, KEPT(CTRL8_XL) = 0xFD},
        .gyro_force = {2142.0f, 10000.0f, 0.070f},
        .accel_force = {737.0f, 13934.0f, 0.122f},
    },
    {
        /* No 4000 dps; compression of the FIFO, low power and the second interface have bits of their own, which all stay 0. */
        .name = "LSM6DSO",
        .who = 0x6C,
        .gyro_fs_dps = UP_TO_2000_DPS,
        .accel_fs_g = ACCEL_FS_G,
        .set = {ALWAYS_SET, KEPT(WHO_AM_I) = 0x6C, KEPT(CTRL9_XL) = DEN_XYZ | I3C_DISABLE},
        .known = {ALWAYS_KNOWN, KEPT(FIFO_CTRL2) = 0xD7, KEPT(COUNTER_BDR_REG1) = 0xA7, KEPT(CTRL2_G) = 0xFE, KEPT(CTRL5_C) = 0xEF,
                  KEPT(CTRL6_C) = 0xFF, KEPT(CTRL7_G) = 0xF7, KEPT(CTRL8_XL) = 0xFF},
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
