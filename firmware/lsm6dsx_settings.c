/* Ranges, rates and filters, and the registers that hold them. */
#include "lsm6dsx.h"
#include "lsm6dsx_registers.h"

enum {
    LATENCY_US = 10000, /* the watermark is what comes in so long */
    SLOTS_MOST = 16, /* of the watermark: a tenth of the FIFO */
};

static const float NOMINAL_HZ[] = {0.0f, 12.5f, 26.0f, 52.0f, 104.0f, 208.0f, 417.0f, 833.0f, 1667.0f, 3333.0f, 6667.0f};

/* A value and the code that the register has for it. */
struct code {
    uint16_t value;
    uint8_t code;
};

static const struct code GYRO_FS[] = {{125, 2}, {250, 0}, {500, 4}, {1000, 8}, {2000, 12}, {4000, 1}, {0, 0}};
static const struct code ACCEL_FS[] = {{2, 0}, {16, 1}, {4, 2}, {8, 3}, {0, 0}};
static const struct code LPF2[] = {{4, 0}, {10, 1}, {20, 2}, {45, 3}, {100, 4}, {200, 5}, {400, 6}, {800, 7}, {0, 0}};

/* The code of a value, or -1. */
static int code_of(const struct code *codes, uint16_t value)
{
    for (; codes->value; codes++)
        if (codes->value == value)
            return codes->code;
    return -1;
}

float lsm6dsx_nominal_hz(uint8_t odr)
{
    return NOMINAL_HZ[odr];
}

uint8_t lsm6dsx_odr(float hz)
{
    for (uint8_t odr = LSM6DSX_SLOWEST; odr <= LSM6DSX_QUICKEST; odr++)
        if (hz > 0.95f * NOMINAL_HZ[odr] && hz < 1.05f * NOMINAL_HZ[odr])
            return odr;
    return 0;
}

int lsm6dsx_possible(const struct lsm6dsx_settings *settings)
{
    return code_of(GYRO_FS, settings->gyro_fs_dps) >= 0 && code_of(ACCEL_FS, settings->accel_fs_g) >= 0 &&
           settings->odr >= LSM6DSX_SLOWEST && settings->odr <= LSM6DSX_QUICKEST &&
           (settings->gyro_lpf1 <= 7 || settings->gyro_lpf1 == LPF1_OFF) &&
           (settings->accel_lpf2_divisor == 2 || code_of(LPF2, settings->accel_lpf2_divisor) >= 0);
}

void lsm6dsx_write_settings(struct lsm6dsx *sensor)
{
    const struct lsm6dsx_settings *settings = &sensor->settings;
    const int lpf2 = code_of(LPF2, settings->accel_lpf2_divisor), lpf1 = settings->gyro_lpf1 != LPF1_OFF;
    const float slots = lsm6dsx_nominal_hz(settings->odr) * (float)LATENCY_US * 1e-6f;
    const unsigned watermark = WORDS_PER_SLOT * (slots < 1.0f ? 1u : slots > (float)SLOTS_MOST ? (unsigned)SLOTS_MOST : (unsigned)slots);
    const uint8_t rate = (uint8_t)(settings->odr << 4);
    lsm6dsx_write(sensor, CTRL3_C, BDU | IF_INC);
    lsm6dsx_write(sensor, CTRL4_C, (uint8_t)(I2C_DISABLE | (lpf1 ? LPF1_SEL_G : 0)));
    lsm6dsx_write(sensor, CTRL6_C, lpf1 ? settings->gyro_lpf1 : 0);
    lsm6dsx_write(sensor, CTRL8_XL, (uint8_t)(lpf2 > 0 ? lpf2 << 5 : 0));
    lsm6dsx_write(sensor, CTRL9_XL, lsm6dsx_read_one(sensor, CTRL9_XL) | DEVICE_CONF);
    lsm6dsx_write(sensor, FIFO_CTRL4, BYPASS);
    lsm6dsx_write(sensor, FIFO_CTRL1, (uint8_t)watermark);
    lsm6dsx_write(sensor, FIFO_CTRL2, 0);
    lsm6dsx_write(sensor, FIFO_CTRL3, (uint8_t)(rate | settings->odr));
    lsm6dsx_write(sensor, INT1_CTRL, INT1_FIFO_TH);
    lsm6dsx_write(sensor, CTRL1_XL, (uint8_t)(rate | code_of(ACCEL_FS, settings->accel_fs_g) << 2 | (lpf2 >= 0 ? LPF2_XL_EN : 0)));
    lsm6dsx_write(sensor, CTRL2_G, (uint8_t)(rate | code_of(GYRO_FS, settings->gyro_fs_dps)));
    lsm6dsx_write(sensor, CTRL10_C, TIMESTAMP_EN);
}

int lsm6dsx_as_set(const struct lsm6dsx *sensor)
{
    const struct lsm6dsx_settings *settings = &sensor->settings;
    const uint8_t *kept = sensor->kept - WHO_AM_I, rate = (uint8_t)(settings->odr << 4);
    const int lpf2 = code_of(LPF2, settings->accel_lpf2_divisor), lpf1 = settings->gyro_lpf1 != LPF1_OFF;
    const int filters = !(kept[CTRL1_XL] & LPF2_XL_EN) == (lpf2 < 0) && kept[CTRL8_XL] >> 5 == (lpf2 > 0 ? lpf2 : 0) &&
                        !(kept[CTRL4_C] & LPF1_SEL_G) == !lpf1 && (!lpf1 || (kept[CTRL6_C] & FTYPE) == settings->gyro_lpf1) &&
                        !(kept[CTRL7_G] & HP_EN_G) && !(kept[CTRL8_XL] & HP_XL);
    return filters && kept[CTRL1_XL] >> 4 == settings->odr && (kept[CTRL1_XL] >> 2 & 3) == code_of(ACCEL_FS, settings->accel_fs_g) &&
           kept[CTRL2_G] == (rate | code_of(GYRO_FS, settings->gyro_fs_dps)) && kept[CTRL3_C] == (BDU | IF_INC) &&
           (kept[CTRL10_C] & TIMESTAMP_EN) && !kept[CTRL5_C];
}

enum fault lsm6dsx_as_kept(const struct lsm6dsx *sensor, const uint8_t now[LSM6DSX_KEPT])
{
    int zeros = 1, ones = 1, same = 1;
    for (unsigned n = 0; n < LSM6DSX_KEPT; n++) {
        zeros &= now[n] == 0x00;
        ones &= now[n] == 0xFF;
        same &= now[n] == sensor->kept[n];
    }
    if (same)
        return FAULTS;
    if (zeros || ones)
        return zeros ? FAULT_ZEROS : FAULT_ONES;
    if (now[0] != LSM6DSX_WHO)
        return FAULT_IDENTITY;
    return now[CTRL1_XL - WHO_AM_I] == 0 && now[CTRL2_G - WHO_AM_I] == 0 ? FAULT_RESET : FAULT_CHANGED;
}
