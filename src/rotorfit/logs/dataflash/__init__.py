"""DataFlash logs of ArduPilot (.bin)."""

from rotorfit.logs.dataflash.read import is_dataflash as is_dataflash
from rotorfit.logs.dataflash.read import read_dataflash as read_dataflash
