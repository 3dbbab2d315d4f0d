/* Registers of the ASM330LHH and its sibling LSM6DSO, by the maker's public headers. */
#ifndef LSM6DSX_REGISTERS_H
#define LSM6DSX_REGISTERS_H

enum {
    FIFO_CTRL1 = 0x07,
    FIFO_CTRL2 = 0x08,
    FIFO_CTRL3 = 0x09,
    FIFO_CTRL4 = 0x0A,
    COUNTER_BDR_REG1 = 0x0B,
    COUNTER_BDR_REG2 = 0x0C,
    INT1_CTRL = 0x0D,
    INT2_CTRL = 0x0E,
    WHO_AM_I = 0x0F,
    CTRL1_XL = 0x10,
    CTRL2_G = 0x11,
    CTRL3_C = 0x12,
    CTRL4_C = 0x13,
    CTRL5_C = 0x14,
    CTRL6_C = 0x15,
    CTRL7_G = 0x16,
    CTRL8_XL = 0x17,
    CTRL9_XL = 0x18,
    CTRL10_C = 0x19,
    STATUS_REG = 0x1E,
    OUTX_L_G = 0x22,
    OUTX_L_A = 0x28,
    FIFO_STATUS1 = 0x3A,
    INTERNAL_FREQ_FINE = 0x63,
    FIFO_DATA_OUT_TAG = 0x78,
};

enum {
    READ = 0x80,                 /* of the address on SPI */
    INT1_FIFO_TH = 1u << 3,       /* INT1_CTRL */
    LPF2_XL_EN = 1u << 1,         /* CTRL1_XL */
    SW_RESET = 1u << 0,           /* CTRL3_C */
    IF_INC = 1u << 2,             /* CTRL3_C: addresses count up by themselves */
    SIM = 1u << 3,                /* CTRL3_C: one line for both directions */
    BDU = 1u << 6,                /* CTRL3_C */
    LPF1_SEL_G = 1u << 1,         /* CTRL4_C */
    I2C_DISABLE = 1u << 2,        /* CTRL4_C */
    DRDY_MASK = 1u << 3,          /* CTRL4_C: no value but 0x7FFD to 0x7FFF before its filter has settled */
    ST_XL_POSITIVE = 1u << 0,     /* CTRL5_C */
    ST_G_POSITIVE = 1u << 2,      /* CTRL5_C */
    DEN_XYZ = 7u << 5,            /* CTRL9_XL, as after a reset; nothing comes of it while DEN is off in CTRL6_C */
    DEVICE_CONF = 1u << 1,        /* CTRL9_XL of the ASM330LHH; the family's application notes ask for it */
    I3C_DISABLE = 1u << 1,        /* CTRL9_XL of the LSM6DSO */
    TIMESTAMP_EN = 1u << 5,       /* CTRL10_C */
    XLDA = 1u << 0,               /* STATUS_REG */
    GDA = 1u << 1,                /* STATUS_REG */
    FIFO_UNUSED = 1u << 2,        /* FIFO_STATUS2; reads 0 */
    FIFO_OVERRUN = (1u << 3) | (1u << 6), /* FIFO_STATUS2: latched, present */
    FIFO_WATERMARK = 1u << 7,     /* FIFO_STATUS2 */
    BYPASS = 0,                  /* FIFO_CTRL4: the FIFO is empty and stays so */
    CONTINUOUS = 6u | (2u << 4) | (1u << 6), /* FIFO_CTRL4: temperature at 12.5 Hz, a stamp for each time slot */
};

#endif
