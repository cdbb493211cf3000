"""Modules of NumPy that SciPy imports without using them are loaded where something uses them.

`import scipy.linalg` takes every public name of NumPy, and so loads `numpy.f2py` with its parser of
Fortran and `numpy.testing`: .15 s, as long as NumPy itself.
"""

from __future__ import annotations

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

POSTPONED: Final = ("f2py", "testing", "ma")
"""Modules of NumPy that neither NumPy itself nor rotorfit needs."""


class _BeforeScipy:
    """A finder that finds nothing, but is asked first when `scipy` is imported."""

    def find_spec(
        self, name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return None, so that the other finders are asked."""
        if name == "scipy" and self in sys.meta_path:
            sys.meta_path.remove(self)
            _postpone_numpy_modules()
        return None


def postpone_imports() -> None:
    """Postpone, from the import of SciPy on, what it would load of NumPy.

    For a program, not for a library: it changes what `sys.modules` holds.
    """
    if "scipy" not in sys.modules and not any(isinstance(f, _BeforeScipy) for f in sys.meta_path):
        sys.meta_path.insert(0, _BeforeScipy())


def _postpone_numpy_modules() -> None:
    """Put modules in place that load themselves when an attribute is asked for."""
    import numpy as np

    for name in POSTPONED:
        place = f"numpy.{name}"
        spec = None if place in sys.modules else find_spec(place)
        if spec is None or spec.loader is None:
            continue
        spec.loader = LazyLoader(spec.loader)
        module = module_from_spec(spec)
        sys.modules[place] = module
        spec.loader.exec_module(module)
        setattr(np, name, module)
