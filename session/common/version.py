"""The version, in one place: the package's, and what every file that is written says it was made with."""

VERSION = "0.1.0"
