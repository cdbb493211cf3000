"""The optional terms of the model, as the experiment file names them.

Mass, thrust, drag torque, first moments and inertia are always there; what else is in the model is
a choice of these terms: by the user, or by what the flights say (`term_choice.py`).
"""

import difflib
from collections.abc import Sequence
from typing import Annotated, Any, Final, cast

from pydantic import BeforeValidator

from rotorfit.model.terms.registry import DEFAULT, OPTIONAL

TERMS: Final = tuple(term.name for term in OPTIONAL)
"""In the order of the documentation."""
DEFAULT_TERMS: Final = tuple(term.name for term in DEFAULT)
"""In the model unless the user says otherwise: every real vehicle has them, and they cost next to
nothing where it has not."""


def known_terms(given: object, info: Any) -> object:
    """Check the terms that a file names; each is named once.

    Raises
    ------
    ValueError
        If a name is no term, with the nearest one; or if the method has terms of its own.
    """
    if given is None or not isinstance(given, list | tuple):
        return given
    if info.data.get("method", "banded") != "banded" or info.data.get("preset") is not None:
        raise ValueError('they belong to method = "banded"; the other methods have their own')
    names = [str(name) for name in cast("Sequence[object]", given)]
    for name in names:
        if name not in TERMS:
            close = difflib.get_close_matches(name, TERMS, n=1, cutoff=0.4)
            nearest = f", did you mean {close[0]!r}?" if close else ";"
            raise ValueError(f"no term {name!r}{nearest} known terms: {', '.join(TERMS)}")
    return tuple(dict.fromkeys(names))


Terms = Annotated[tuple[str, ...], BeforeValidator(known_terms)]
"""What stands under ``terms`` of an experiment."""
