"""Blackbox logs of Betaflight, INAV and INDIflight."""

from rotorfit.logs.blackbox.decode import BlackboxLog as BlackboxLog
from rotorfit.logs.blackbox.decode import Table as Table
from rotorfit.logs.blackbox.decode import decode as decode
from rotorfit.logs.blackbox.read import LogEntry as LogEntry
from rotorfit.logs.blackbox.read import is_blackbox as is_blackbox
from rotorfit.logs.blackbox.read import list_blackbox_logs as list_blackbox_logs
from rotorfit.logs.blackbox.read import read_blackbox as read_blackbox
