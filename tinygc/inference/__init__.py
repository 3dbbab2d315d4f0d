"""Rows with a noise, hypotheses that add columns, evidence that chooses, held-out rows that prove: statistics without any physics."""
