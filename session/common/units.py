"""The only conversion factors in the project."""

from math import pi

STANDARD_GRAVITY_MPS2 = 9.80665  #: one g of an accelerometer's datasheet
EARTH_RATE_RPS = 7.292115e-5  #: WGS 84

DEG = pi / 180  #: rad per degree; also rad/s per dps
MDPS = 1e-3 * DEG  #: rad/s per mdps
G = STANDARD_GRAVITY_MPS2  #: m/s^2 per g
MG = 1e-3 * G  #: m/s^2 per mg
DEG_PER_SQRT_HOUR = DEG / 60  #: rad/sqrt(s) per deg/sqrt(h), the unit of angle random walk
DEG_PER_HOUR = DEG / 3600  #: rad/s per deg/h, the unit of bias instability
NS = 1e-9  #: s per nanosecond
NS_PER_S = 10**9  #: exact, unlike 1 / NS
