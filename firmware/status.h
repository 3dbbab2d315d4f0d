/* Status of the board, once a second and on request: info, board and faults frames. */
#ifndef STATUS_H
#define STATUS_H

#include <stdint.h>

void status_start(uint32_t baud);

/* The host's port has another rate now. */
void status_baud(uint32_t baud);
uint32_t status_rate_of_port(void);

/* All three frames. */
void status_send(void);

/* Those that are due: all once a second, faults soon after a count has risen. */
void status_service(void);

/* Without a sensor: a sample with this stamp comes.  Its kind gives the rate that the stamps show, once a second of samples. */
void status_pace(uint32_t t_us);

#endif
