/* Reading what may not be there; and every other fault of the core, which is a reset. */
#ifndef FAULT_H
#define FAULT_H

#include <stdint.h>

/* What the last fault was, for a debugger: kept through resets, not through a power-up. */
struct fault_record {
    uint32_t known; /* FAULT_KNOWN where the rest is one */
    uint32_t count; /* since power-up */
    uint32_t pc, lr, status, address; /* of the program; CFSR, BFAR */
    uint32_t fresh; /* 1 until the program that follows has looked at it */
};

enum { FAULT_KNOWN = 0x0FA17 };

extern struct fault_record fault_record;

/* A word at an address where some emulators have nothing, and reading is a fault: then 0. */
uint32_t read_if_there(uint32_t address);

/* Start again.  Does not return. */
void fault_reset(void);

void HardFault_Handler(void);

#endif
