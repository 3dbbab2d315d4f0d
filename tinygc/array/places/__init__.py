"""Where each unit is: its clock and its mounting against the first unit's, from the rates that all of them felt."""
