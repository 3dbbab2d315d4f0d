/* For the Arduino IDE, which compiles what lies in this folder: the driver itself is one floor up. */
#include "../lsm6dsx.h"
