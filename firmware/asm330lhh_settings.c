/* Ranges, rates and filters, and the registers that hold them. */
#include "asm330lhh.h"
#include "asm330lhh_registers.h"

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

float asm330lhh_nominal_hz(uint8_t odr)
{
    return NOMINAL_HZ[odr];
}

uint8_t asm330lhh_odr(float hz)
{
    for (uint8_t odr = ASM330LHH_SLOWEST; odr <= ASM330LHH_QUICKEST; odr++)
        if (hz > 0.95f * NOMINAL_HZ[odr] && hz < 1.05f * NOMINAL_HZ[odr])
            return odr;
    return 0;
}

int asm330lhh_possible(const struct asm330lhh_settings *settings)
{
    return code_of(GYRO_FS, settings->gyro_fs_dps) >= 0 && code_of(ACCEL_FS, settings->accel_fs_g) >= 0 &&
           settings->odr >= ASM330LHH_SLOWEST && settings->odr <= ASM330LHH_QUICKEST &&
           (settings->gyro_lpf1 <= 7 || settings->gyro_lpf1 == LPF1_OFF) &&
           (settings->accel_lpf2_divisor == 2 || code_of(LPF2, settings->accel_lpf2_divisor) >= 0);
}

void asm330lhh_write_settings(struct asm330lhh *sensor)
{
    const struct asm330lhh_settings *settings = &sensor->settings;
    const int lpf2 = code_of(LPF2, settings->accel_lpf2_divisor), lpf1 = settings->gyro_lpf1 != LPF1_OFF;
    const float slots = asm330lhh_nominal_hz(settings->odr) * (float)LATENCY_US * 1e-6f;
    const unsigned watermark = WORDS_PER_SLOT * (slots < 1.0f ? 1u : slots > (float)SLOTS_MOST ? (unsigned)SLOTS_MOST : (unsigned)slots);
    const uint8_t rate = (uint8_t)(settings->odr << 4);
    asm330lhh_write(sensor, CTRL3_C, BDU | IF_INC);
    asm330lhh_write(sensor, CTRL4_C, (uint8_t)(I2C_DISABLE | (lpf1 ? LPF1_SEL_G : 0)));
    asm330lhh_write(sensor, CTRL6_C, lpf1 ? settings->gyro_lpf1 : 0);
    asm330lhh_write(sensor, CTRL8_XL, (uint8_t)(lpf2 > 0 ? lpf2 << 5 : 0));
    asm330lhh_write(sensor, CTRL9_XL, asm330lhh_read_one(sensor, CTRL9_XL) | DEVICE_CONF);
    asm330lhh_write(sensor, FIFO_CTRL4, BYPASS);
    asm330lhh_write(sensor, FIFO_CTRL1, (uint8_t)watermark);
    asm330lhh_write(sensor, FIFO_CTRL2, 0);
    asm330lhh_write(sensor, FIFO_CTRL3, (uint8_t)(rate | settings->odr));
    asm330lhh_write(sensor, INT1_CTRL, INT1_FIFO_TH);
    asm330lhh_write(sensor, CTRL1_XL, (uint8_t)(rate | code_of(ACCEL_FS, settings->accel_fs_g) << 2 | (lpf2 >= 0 ? LPF2_XL_EN : 0)));
    asm330lhh_write(sensor, CTRL2_G, (uint8_t)(rate | code_of(GYRO_FS, settings->gyro_fs_dps)));
    asm330lhh_write(sensor, CTRL10_C, TIMESTAMP_EN);
}

int asm330lhh_as_set(const struct asm330lhh *sensor)
{
    const struct asm330lhh_settings *settings = &sensor->settings;
    const uint8_t *kept = sensor->kept - WHO_AM_I, rate = (uint8_t)(settings->odr << 4);
    const int lpf2 = code_of(LPF2, settings->accel_lpf2_divisor), lpf1 = settings->gyro_lpf1 != LPF1_OFF;
    const int filters = !(kept[CTRL1_XL] & LPF2_XL_EN) == (lpf2 < 0) && kept[CTRL8_XL] >> 5 == (lpf2 > 0 ? lpf2 : 0) &&
                        !(kept[CTRL4_C] & LPF1_SEL_G) == !lpf1 && (!lpf1 || (kept[CTRL6_C] & FTYPE) == settings->gyro_lpf1) &&
                        !(kept[CTRL7_G] & HP_EN_G) && !(kept[CTRL8_XL] & HP_XL);
    return filters && kept[CTRL1_XL] >> 4 == settings->odr && (kept[CTRL1_XL] >> 2 & 3) == code_of(ACCEL_FS, settings->accel_fs_g) &&
           kept[CTRL2_G] == (rate | code_of(GYRO_FS, settings->gyro_fs_dps)) && kept[CTRL3_C] == (BDU | IF_INC) &&
           (kept[CTRL10_C] & TIMESTAMP_EN) && !kept[CTRL5_C];
}

enum fault asm330lhh_as_kept(const struct asm330lhh *sensor, const uint8_t now[ASM330LHH_KEPT])
{
    int zeros = 1, ones = 1, same = 1;
    for (unsigned n = 0; n < ASM330LHH_KEPT; n++) {
        zeros &= now[n] == 0x00;
        ones &= now[n] == 0xFF;
        same &= now[n] == sensor->kept[n];
    }
    if (same)
        return FAULTS;
    if (zeros || ones)
        return zeros ? FAULT_ZEROS : FAULT_ONES;
    if (now[0] != ASM330LHH_WHO)
        return FAULT_IDENTITY;
    return now[CTRL1_XL - WHO_AM_I] == 0 && now[CTRL2_G - WHO_AM_I] == 0 ? FAULT_RESET : FAULT_CHANGED;
}
