"""Logs of PX4 (ULog)."""

from rotorfit.logs.ulog.read import is_ulog as is_ulog
from rotorfit.logs.ulog.read import read_ulog as read_ulog
