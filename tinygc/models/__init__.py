"""Models: maps from measured rates to calibrated ones, and the files of each kind."""

from tinygc.models.files import from_dict as from_dict
from tinygc.models.files import load as load
from tinygc.models.files import load_with_table as load_with_table
from tinygc.models.files import to_dict as to_dict
