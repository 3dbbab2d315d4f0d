/* The watchdog: a loop that stands still is a reset.  And why the board started. */
#ifndef BOARD_WATCHDOG_H
#define BOARD_WATCHDOG_H

/* From here on board_alive must be called each 0.6 s; nothing but a reset ends that.  make WATCHDOG=0 leaves it out. */
void board_watchdog_start(void);

/* The loop has done all its parts once more.  It counts only where time goes on, too: without SysTick nothing is done in time. */
void board_alive(void);

/* Why the program started.  Others: power-up, the pin, or a requested reset, as by a flasher. */
enum cause { BY_OTHERS = 0, BY_WATCHDOG = 1, BY_FAULT = 2 }; /* the last: of the core; fault_record names it */

enum cause board_cause(void);

#endif
