"""Physical parameters of a multirotor, with intervals, from ordinary flight logs."""

__version__ = "0.1.0.dev0"
