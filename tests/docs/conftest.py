"""The pages fly the same few experiments."""

from shared_work import shared_bandwidths as shared_bandwidths
from shared_work import shared_experiments as shared_experiments
from shared_work import shared_manoeuvres as shared_manoeuvres
