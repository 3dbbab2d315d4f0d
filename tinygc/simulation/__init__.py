"""A session that nobody recorded: a hand-turned three-axis table under an ASM330LHH."""
