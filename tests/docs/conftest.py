"""The pages fly the same few experiments."""

from shared_work import shared_experiments as shared_experiments
