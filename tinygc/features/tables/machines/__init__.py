"""Machines that turn the table: five verbs, the makes that speak them, their limits, and the log of their angles."""
