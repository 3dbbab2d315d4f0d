/* The watchdog: a loop that stands still is a reset.  And why the board started. */
#ifndef BOARD_WATCHDOG_H
#define BOARD_WATCHDOG_H

/* From here on board_alive must be called each 0.6 s; nothing but a reset ends that.  make WATCHDOG=0 leaves it out. */
void board_watchdog_start(void);

/* The loop has done all its parts once more.  It counts only where time goes on, too: without SysTick nothing is done in time. */
void board_alive(void);

/* Whether the board reset itself the last time: its watchdog, or a fault of the core (fault.h). */
int board_was_reset(void);

#endif
