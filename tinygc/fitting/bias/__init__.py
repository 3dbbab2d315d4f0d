"""The bias of the day: from the first still, from gravity, over several days."""

#: what is left beside a fit's own files: the stored model with its new bias, and its figures
MODEL, FIGURES = "model_rebiased.json", "rebiased.json"
