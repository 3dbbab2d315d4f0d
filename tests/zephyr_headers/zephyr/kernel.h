#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

int32_t k_usleep(int32_t us);
int32_t k_msleep(int32_t ms);
int64_t k_uptime_get(void);
int64_t k_uptime_ticks(void);
uint64_t k_ticks_to_us_floor64(uint64_t ticks);
