"""Recordings of a gyroscope alone, whose turns are known beforehand: their folders, their clock, their rests."""

#: ``protocol.reference`` of a gyroscope alone
TURNS = "turns"
