"""The register map: addresses, the bits that can be written, the values after a reset, and what the codes mean."""

from __future__ import annotations

PIN_CTRL = 0x02
FIFO_CTRL1, FIFO_CTRL2, FIFO_CTRL3, FIFO_CTRL4 = 0x07, 0x08, 0x09, 0x0A
COUNTER_BDR_REG1, COUNTER_BDR_REG2 = 0x0B, 0x0C
INT1_CTRL, INT2_CTRL = 0x0D, 0x0E
WHO_AM_I = 0x0F
CTRL1_XL, CTRL2_G, CTRL3_C, CTRL4_C, CTRL5_C = 0x10, 0x11, 0x12, 0x13, 0x14
CTRL6_C, CTRL7_G, CTRL8_XL, CTRL9_XL, CTRL10_C = 0x15, 0x16, 0x17, 0x18, 0x19
STATUS_REG = 0x1E
OUT_TEMP_L, OUTX_L_G, OUTX_L_A = 0x20, 0x22, 0x28
OUT_FIRST, OUT_LAST = 0x20, 0x2D
FIFO_STATUS1, FIFO_STATUS2 = 0x3A, 0x3B
TIMESTAMP0, TIMESTAMP2, TIMESTAMP3 = 0x40, 0x42, 0x43
INTERNAL_FREQ_FINE = 0x63
X_OFS_USR, Y_OFS_USR, Z_OFS_USR = 0x73, 0x74, 0x75
FIFO_DATA_OUT_TAG, FIFO_DATA_OUT_LAST = 0x78, 0x7E

IDENTITY = 0x6B
TIMESTAMP_RESET = 0xAA

#: address -> bits with a name in the map: all others are reserved, and stay 0
WRITABLE = {
    PIN_CTRL: 0xFF,
    FIFO_CTRL1: 0xFF,
    FIFO_CTRL2: 0b1001_0001,
    FIFO_CTRL3: 0xFF,
    FIFO_CTRL4: 0b1111_0111,
    COUNTER_BDR_REG1: 0b1110_0011,
    COUNTER_BDR_REG2: 0xFF,
    INT1_CTRL: 0xFF,
    INT2_CTRL: 0xFF,
    CTRL1_XL: 0b1111_1110,
    CTRL2_G: 0xFF,
    CTRL3_C: 0b1111_1101,
    CTRL4_C: 0b0110_1110,
    CTRL5_C: 0b0110_1111,
    CTRL6_C: 0b1110_1111,
    CTRL7_G: 0b0111_0010,
    CTRL8_XL: 0b1111_1101,
    CTRL9_XL: 0b1111_1110,
    CTRL10_C: 0b0010_0000,
    X_OFS_USR: 0xFF,
    Y_OFS_USR: 0xFF,
    Z_OFS_USR: 0xFF,
}
#: after a reset, where not 0
DEFAULTS = {PIN_CTRL: 0x3F, CTRL3_C: 0x04, CTRL9_XL: 0xE0}

# CTRL3_C
SW_RESET, IF_INC, H_LACTIVE, BDU, BOOT = 1 << 0, 1 << 2, 1 << 5, 1 << 6, 1 << 7
SLEEP_G = 1 << 6  # CTRL4_C
TIMESTAMP_EN = 1 << 5  # CTRL10_C
ODRCHG_EN, STOP_ON_WTM = 1 << 4, 1 << 7  # FIFO_CTRL2
DATAREADY_PULSED = 1 << 7  # COUNTER_BDR_REG1
RST_COUNTER_BDR, TRIG_COUNTER_BDR = 1 << 6, 1 << 5
# INT1_CTRL
INT1_DRDY_XL, INT1_DRDY_G, INT1_BOOT = 1 << 0, 1 << 1, 1 << 2
INT1_FIFO_TH, INT1_FIFO_OVR, INT1_FIFO_FULL, INT1_CNT_BDR = 1 << 3, 1 << 4, 1 << 5, 1 << 6
# STATUS_REG
XLDA, GDA, TDA = 1, 2, 4
# FIFO_STATUS2
OVER_RUN_LATCHED, COUNTER_BDR_IA, FIFO_FULL_IA, FIFO_OVR_IA, FIFO_WTM_IA = 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7

#: ticks of the 6667 Hz clock in a sample, by code of odr_xl, odr_g, bdr_xl, bdr_gy
COEFFICIENTS = {code: 1 << (10 - code) for code in range(1, 11)}
BDR_GY_COEFFICIENTS = COEFFICIENTS | {11: 1024}
#: of odr_t_batch and of dec_ts_batch
TEMPERATURE_TICKS = {1: 4096, 2: 512, 3: 128}
TIMESTAMP_DECIMATION = {1: 1, 2: 8, 3: 32}

#: fs_g -> mdps/LSB, fs_xl -> mg/LSB
GYRO_MDPS = {2: 4.375, 0: 8.75, 4: 17.5, 8: 35.0, 12: 70.0, 1: 140.0}
ACCEL_MG = {0: 0.061, 2: 0.122, 3: 0.244, 1: 0.488}
TEMPERATURE_LSB, TEMPERATURE_ZERO_C = 256.0, 25.0

# Tags
GYRO, ACCEL, TEMPERATURE, TIMESTAMP, CONFIG_CHANGE = 1, 2, 3, 4, 5

CLOCK_HZ, TICKS_HZ, FINE_STEP = 6667.0, 40000.0, 0.0015


def with_even_parity(byte: int) -> int:
    """A tag byte whose bit 0 makes the number of its ones even."""
    byte &= 0xFE
    return byte | byte.bit_count() & 1


def tag_byte(sensor: int, count: int) -> int:
    """Parity, TAG_CNT in bits 2:1, TAG_SENSOR in bits 7:3."""
    return with_even_parity((sensor & 31) << 3 | (count & 3) << 1)
