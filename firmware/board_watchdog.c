#include "board_watchdog.h"

#include <stdbool.h>

#include "board.h"
#include "board_registers.h"
#include "fault.h"

#ifndef WATCHDOG
#define WATCHDOG 1
#endif

#define IWDG_KR REG(0x40003000u)
#define IWDG_PR REG(0x40003004u)
#define IWDG_RLR REG(0x40003008u)
#define IWDG_SR REG(0x4000300Cu)
#define RCC_CSR REG(RCC + 0x74u)
#define DBGMCU_APB1_FZ REG(0xE0042008u)

enum {
    START = 0xCCCC,
    ACCESS = 0x5555,
    RELOAD = 0xAAAA,
    /* The LSI has 32 kHz, by the data sheet 17 to 47.  A thousand times 32 of its cycles: 1 s, 0.68 to 1.88. */
    THIRTY_SECOND = 3,
    PERIOD = 1000,
    SPINS = 100000, /* until both have been taken over: five cycles of the LSI */
    DBG_IWDG_STOP = 1u << 12,
};

/* Of RCC_CSR. */
#define REMOVE_FLAGS (1u << 24)
#define SOFTWARE_RESET (1u << 28)
#define WATCHDOG_RESET (1u << 29)

static enum cause cause;

/* A fault's record counts once: the next requested reset has nothing to do with it. */
static enum cause cause_of(uint32_t flags)
{
    const bool faulty = (fault_record.known == FAULT_KNOWN) && (fault_record.fresh == 1u);
    fault_record.fresh = 0;
    if ((flags & WATCHDOG_RESET) != 0u)
        return BY_WATCHDOG;
    return (((flags & SOFTWARE_RESET) != 0u) && faulty) ? BY_FAULT : BY_OTHERS;
}

void board_watchdog_start(void)
{
    cause = cause_of(RCC_CSR);
    RCC_CSR |= REMOVE_FLAGS;
    if (!WATCHDOG)
        return;
    DBGMCU_APB1_FZ |= DBG_IWDG_STOP; /* it waits while a debugger holds the core */
    IWDG_KR = START;
    IWDG_KR = ACCESS;
    IWDG_PR = THIRTY_SECOND;
    IWDG_RLR = PERIOD - 1;
    for (int spin = 0; spin < SPINS && IWDG_SR; spin++)
        ;
    IWDG_KR = RELOAD;
}

void board_alive(void)
{
    static uint32_t alive_ms;
    const uint32_t now_ms = board_milliseconds();
    if (WATCHDOG && (now_ms != alive_ms))
        IWDG_KR = RELOAD;
    alive_ms = now_ms;
}

enum cause board_cause(void)
{
    return cause;
}
