"""Which configurations a result has, and which of them is meant."""

from collections.abc import Sequence

from rotorfit.results.result import IdentificationResult


def configuration_names(result: IdentificationResult) -> list[str]:
    """Return the names of a result's configurations in their order."""
    return list(dict.fromkeys(p.configuration for p in result.parameters if p.configuration))


def meant_configuration(names: Sequence[str], said: str | None) -> str | None:
    """Return the configuration that is meant; None where it is not among them.

    Parameters
    ----------
    names
        Of a result.
    said
        What the user calls it; may be None where there is one.
    """
    if said is None and len(names) == 1:
        return names[0]
    return said if said in names else None
