// Any IMU on I2C for `calibrate.py record --baud 115200`: registers as text, stamped when they are new.  docs/boards.md explains it.
// What follows is an MPU-6050 (GY-521) at 100 Hz, 500 dps, 4 g.  Another sensor is another block of these lines.
#include <Wire.h>
const char INFO[] = "# gyro_fs_dps=500 accel_fs_g=4 odr_hz=100 serial=bench-1 sensor=MPU-6050"; // another serial for each sensor
const uint8_t CHIP = 0x68, WHO = 0x75;                 // address on the bus; the register that holds its name: the first of these,
const uint8_t NAMES[] = {0x68, 0x98, 0x70, 0x71, 0x72, 0x73, 0x74, 0x75}; // or of kin that cheap boards bear, with the same registers
const uint8_t SETUP[][2] = {{0x6B, 1}, {0x1A, 3}, {0x19, 9}, {0x1B, 8}, {0x1C, 8}, {0x38, 1}}; // awake, 44 Hz, 100 Hz, ranges, "new"
const uint8_t STATUS = 0x3A, NEW = 0x01;               // the register and the bits that show a new sample
const uint8_t FIRST = 0x3B, ACCEL = 0, TEMP = 3, GYRO = 4; // seven numbers from this register on: which of them are what
const bool HIGH_FIRST = true;                          // of a number's two bytes

uint8_t bytes[14], who; char line[80];

bool fetch(uint8_t address, uint8_t count) {
  Wire.beginTransmission(CHIP);
  Wire.write(address);
  if (Wire.endTransmission(false) != 0 || Wire.requestFrom(CHIP, count) != count) return false;
  for (uint8_t n = 0; n < count; n++) bytes[n] = Wire.read();
  return true;
}
int number(uint8_t n) { return (int16_t)(bytes[2 * n + !HIGH_FIRST] << 8 | bytes[2 * n + HIGH_FIRST]); }
void remark(const char *text) { snprintf(line, sizeof line, text, CHIP, who, NAMES[0]), Serial.println(line); }

void setup() {
  Serial.begin(115200);
  Wire.begin();
  Wire.setClock(400000);
  for (bool known = false; !known; delay(known ? 0 : 1000)) {
    if (!fetch(WHO, 1)) { remark("# nothing answers at 0x%02X: look at SDA, SCL, 3.3 V, GND, AD0, CHIP"); continue; }
    who = bytes[0];
    for (uint8_t name : NAMES) known |= who == name;
    if (!known) remark("# WHO_AM_I at 0x%02X reads 0x%02X, not 0x%02X: another sensor, see NAMES");
  }
  for (auto &pair : SETUP) Wire.beginTransmission(CHIP), Wire.write(pair[0]), Wire.write(pair[1]), Wire.endTransmission();
}

void loop() {
  static unsigned long sent_us = micros() - 4000000; // record waits ten seconds for INFO: it comes each four
  if (!fetch(STATUS, 1) || (bytes[0] & NEW) != NEW) return;
  const unsigned long t_us = micros();                 // now, and not once it has been printed
  if (!fetch(FIRST, 14)) return;                       // a gap in the stamps, which record counts
  if (t_us - sent_us >= 4000000) {
    sent_us = t_us, Serial.println(INFO);
    if (who == NAMES[0]) Serial.println("t_us,gx,gy,gz,ax,ay,az,temp");
    else remark("# at 0x%02X WHO_AM_I 0x%02X: taken for 0x%02X"); // and the columns are the usual ones
  }
  snprintf(line, sizeof line, "%lu,%d,%d,%d,%d,%d,%d,%d", t_us, number(GYRO), number(GYRO + 1), number(GYRO + 2),
           number(ACCEL), number(ACCEL + 1), number(ACCEL + 2), number(TEMP));
  Serial.println(line);
}
