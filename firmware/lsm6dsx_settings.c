/* Ranges, rates and filters, the registers that hold them, and how long they take to settle. */
#include "lsm6dsx.h"
#include "lsm6dsx_registers.h"

enum {
    LATENCY_US = 10000, /* the watermark is what comes in so long */
    SLOTS_MOST = 16, /* of the watermark: a tenth of the FIFO */
    FTYPE_MOST = 7,
    GYRO_SLOTS = 3,
    ACCEL_SLOTS = 2,
    NO_LPF2 = 2, /* the divisor */
    LPF2_MOST = 8,
};

static const float NOMINAL_HZ[] = {0.0f, 12.5f, 26.0f, 52.0f, 104.0f, 208.0f, 417.0f, 833.0f, 1667.0f, 3333.0f, 6667.0f};

/* Slots that are no samples when both sensors have just been switched on, as ST's Linux driver st_asm330lhhx discards them.  Of the
 * gyroscope: 70 ms and 3 slots, and with LPF1 what its table has at 12.5 to 833 Hz, which is a time.  Of the accelerometer 2 slots, and
 * those of LPF2, whatever the rate. */
static const float GYRO_START_S = 0.070f;
static const float LPF1_S[FTYPE_MOST + 1] = {0.0040f, 0.0050f, 0.0065f, 0.0025f, 0.0110f, 0.0220f, 0.0290f, 0.0580f};

static const struct {
    uint16_t divisor, slots;
    uint8_t code;
} LPF2[LPF2_MOST] = {{4, 0, 0}, {10, 10, 1}, {20, 19, 2}, {45, 38, 3}, {100, 75, 4}, {200, 150, 5}, {400, 296, 6}, {800, 595, 7}};

/* Their place; LPF2_MOST where LPF2 is off, or has no such divisor. */
static unsigned lpf2_of(uint16_t divisor)
{
    unsigned place = 0;
    while ((place < (unsigned)LPF2_MOST) && (LPF2[place].divisor != divisor))
        place++;
    return place;
}

/* The entry of a value, or the one behind the last. */
static const struct lsm6dsx_code *find(const struct lsm6dsx_code *codes, uint16_t value)
{
    unsigned place = 0;
    while ((codes[place].value != 0u) && (codes[place].value != value))
        place++;
    return &codes[place];
}

float lsm6dsx_nominal_hz(uint8_t odr)
{
    return (odr <= LSM6DSX_QUICKEST) ? NOMINAL_HZ[odr] : 0.0f;
}

uint8_t lsm6dsx_odr(float hz)
{
    uint8_t found = 0;
    for (uint8_t odr = LSM6DSX_SLOWEST; odr <= LSM6DSX_QUICKEST; odr++) {
        if ((hz > (0.95f * NOMINAL_HZ[odr])) && (hz < (1.05f * NOMINAL_HZ[odr])))
            found = odr;
    }
    return found;
}

bool lsm6dsx_possible(const struct lsm6dsx_settings *settings, const struct lsm6dsx_chip *chip)
{
    const bool ranges = (chip == 0) || ((settings->gyro_fs_dps != 0u) && (find(chip->gyro_fs_dps, settings->gyro_fs_dps)->value != 0u) &&
                                        (settings->accel_fs_g != 0u) && (find(chip->accel_fs_g, settings->accel_fs_g)->value != 0u));
    const bool lpf1 = (settings->gyro_lpf1 <= FTYPE_MOST) || (settings->gyro_lpf1 == LPF1_OFF);
    const bool lpf2 = (settings->accel_lpf2_divisor == NO_LPF2) || (lpf2_of(settings->accel_lpf2_divisor) < (unsigned)LPF2_MOST);
    return ranges && lpf1 && lpf2 && (settings->odr >= LSM6DSX_SLOWEST) && (settings->odr <= LSM6DSX_QUICKEST);
}

uint16_t lsm6dsx_unsettled(const struct lsm6dsx_settings *settings, int8_t freq_fine)
{
    const float hz = fifo_rate_hz(settings->odr, freq_fine);
    const unsigned place = lpf2_of(settings->accel_lpf2_divisor);
    unsigned gyro = (unsigned)GYRO_SLOTS + 1u + (unsigned)(hz * GYRO_START_S);
    const unsigned accel = (unsigned)ACCEL_SLOTS + ((place < (unsigned)LPF2_MOST) ? LPF2[place].slots : 0u);
    if (settings->gyro_lpf1 <= FTYPE_MOST)
        gyro += 1u + (unsigned)(hz * LPF1_S[settings->gyro_lpf1]);
    return (uint16_t)((gyro > accel) ? gyro : accel);
}

void lsm6dsx_image(const struct lsm6dsx *sensor, uint8_t image[LSM6DSX_KEPT])
{
    const struct lsm6dsx_settings *settings = &sensor->settings;
    const float slots = lsm6dsx_nominal_hz(settings->odr) * (float)LATENCY_US * 1e-6f;
    const unsigned whole = (slots < 1.0f) ? 1u : ((slots > (float)SLOTS_MOST) ? (unsigned)SLOTS_MOST : (unsigned)slots);
    const unsigned place = lpf2_of(settings->accel_lpf2_divisor);
    const uint8_t rate = (uint8_t)(settings->odr << 4);
    for (unsigned n = 0; n < LSM6DSX_KEPT; n++)
        image[n] = sensor->chip->set[n];
    image[0] = (uint8_t)(WORDS_PER_SLOT * whole); /* FIFO_CTRL1 */
    image[FIFO_CTRL3 - FIFO_CTRL1] = (uint8_t)(rate | settings->odr);
    image[CTRL1_XL - FIFO_CTRL1] = (uint8_t)(rate | (find(sensor->chip->accel_fs_g, settings->accel_fs_g)->code << 2));
    image[CTRL2_G - FIFO_CTRL1] = (uint8_t)(rate | find(sensor->chip->gyro_fs_dps, settings->gyro_fs_dps)->code);
    if (settings->gyro_lpf1 <= FTYPE_MOST) {
        image[CTRL4_C - FIFO_CTRL1] |= LPF1_SEL_G;
        image[CTRL6_C - FIFO_CTRL1] |= settings->gyro_lpf1;
    }
    if (place < (unsigned)LPF2_MOST) {
        image[CTRL1_XL - FIFO_CTRL1] |= LPF2_XL_EN;
        image[CTRL8_XL - FIFO_CTRL1] |= (uint8_t)(LPF2[place].code << 5);
    }
}

/* The others are 0, as a reset leaves them.  Filters and ranges first, both sensors on behind them; the FIFO stays in bypass. */
void lsm6dsx_write_settings(struct lsm6dsx *sensor)
{
    static const uint8_t ORDER[] = {CTRL3_C,    CTRL4_C,    CTRL6_C,   CTRL8_XL, CTRL9_XL, FIFO_CTRL4, FIFO_CTRL1,
                                    FIFO_CTRL2, FIFO_CTRL3, INT1_CTRL, CTRL1_XL, CTRL2_G,  CTRL10_C};
    uint8_t image[LSM6DSX_KEPT];
    lsm6dsx_image(sensor, image);
    for (unsigned n = 0; n < sizeof ORDER; n++)
        lsm6dsx_write(sensor, ORDER[n], (ORDER[n] == FIFO_CTRL4) ? (uint8_t)BYPASS : image[ORDER[n] - FIFO_CTRL1]);
}

bool lsm6dsx_alike(const uint8_t *known, const uint8_t *image, const uint8_t *now, unsigned count)
{
    bool alike = true;
    for (unsigned n = 0; n < count; n++)
        alike = alike && (((image[n] ^ now[n]) & known[n]) == 0);
    return alike;
}

enum fault lsm6dsx_as_kept(const struct lsm6dsx *sensor, const uint8_t now[LSM6DSX_KEPT])
{
    bool zeros = true, ones = true;
    for (unsigned n = 0; n < LSM6DSX_KEPT; n++) {
        zeros = zeros && (now[n] == 0x00u);
        ones = ones && (now[n] == 0xFFu);
    }
    const uint8_t who = now[LSM6DSX_KEPT_WHO];
    const bool off = (now[CTRL1_XL - FIFO_CTRL1] == 0u) && (now[CTRL2_G - FIFO_CTRL1] == 0u);
    if (lsm6dsx_alike(sensor->chip->known, sensor->kept, now, LSM6DSX_KEPT))
        return FAULTS;
    if (zeros || ones)
        return zeros ? FAULT_ZEROS : FAULT_ONES;
    if ((who != sensor->kept[LSM6DSX_KEPT_WHO]) && !(off && (lsm6dsx_chip_of(who) != 0)))
        return FAULT_IDENTITY;
    return off ? FAULT_RESET : FAULT_CHANGED;
}
