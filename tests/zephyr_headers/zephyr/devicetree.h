/* As much of Zephyr as firmware/zephyr uses: declarations of our own, after the public documentation of its API.  board.c is behind them. */
#pragma once

#define BUILD_ASSERT(condition, message) _Static_assert(condition, message)
#define DT_NODELABEL(label) label
#define DT_CHOSEN(name) name
#define DT_PROP_OR(node, name, otherwise) CONSOLE_SPEED
