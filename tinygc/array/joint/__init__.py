"""The joint estimate of all units' numbers under one motion, and what turns miss by: common, or a unit's own."""
