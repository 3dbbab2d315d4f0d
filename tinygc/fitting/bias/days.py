"""The bias of several days, under the name of the biases; it stands below them, where ``fit --bias-per-log`` takes it from."""

from tinygc.fitting.days import Levelled, bias_by_log, level_days, levelled

__all__ = ["Levelled", "bias_by_log", "level_days", "levelled"]
