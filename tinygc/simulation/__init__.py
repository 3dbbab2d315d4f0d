"""Simulated sessions: a hand-turned three-axis table that carries an ASM330LHH."""
