"""A file to a FlightLog; one module per format."""

from rotorfit.logs.columns import ColumnSpec as ColumnSpec
from rotorfit.logs.formats import ReadOptions as ReadOptions
from rotorfit.logs.read import read_log as read_log
