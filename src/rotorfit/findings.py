"""Findings of checks: one type for refusals, doubts, notes, and checks that passed."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

Severity = Literal["refusal", "doubt", "note", "passed"]


@frozen_dataclass
class Evidence:
    """A quantity that a check measured, such as ``thrust_over_weight``.

    - `name`: under which it stands among the diagnostics of a result.
    - `value`: measured, SI.
    - `interval`: its 95 % interval, where the check has one.
    - `limit`: the value beyond which the check objects.
    """

    name: str
    value: float
    interval: tuple[float, float] | None = None
    limit: float | None = None


@frozen_dataclass
class Finding:
    """What one check says of a log, a flight or a fit.

    - `kind`: of the check, such as ``residual-peak``.
    - `severity`: ``refusal`` (nothing can be identified), ``doubt`` (a number may be wrong),
      ``note`` (to know), or ``passed`` (the check was made and objects to nothing).
    - `sentence`: what was met, what was expected and what to do; empty if the check passed.
    - `numbers`: names of the numbers it is about, such as ``kt`` or ``Ixx@A``; ``Ixx`` is that of
      every configuration; empty: all.
    - `flights`: files of the flights it is about; empty: all.
    - `evidence`: the quantities behind it.
    - `next_step`: what to do, where that is not in the sentence alone.
    - `withheld_because`: why the numbers are withheld from the result; None if they are not.
    - `doubtful_because`: why the numbers may be outside their intervals, which makes them
      `doubtful`; None if the intervals cover what the check found.
    - `useless_because`: why no flying helps the numbers before the next step is taken; None if
      it does.
    """

    kind: str
    severity: Severity
    sentence: str = ""
    numbers: tuple[str, ...] = ()
    flights: tuple[str, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    next_step: str | None = None
    withheld_because: str | None = None
    doubtful_because: str | None = None
    useless_because: str | None = None

    @property
    def diagnostics(self) -> dict[str, float]:
        """The measured quantities by name."""
        return {one.name: one.value for one in self.evidence}

    def is_about(self, full_name: str) -> bool:
        """Whether it names a number such as ``Ixx@A``, or its like of every configuration.

        The thrust coefficients of single rotors, ``kt_1`` and so on, go with ``kt``.
        """
        base = full_name.partition("@")[0]
        return bool({full_name, base, base.rstrip("0123456789").rstrip("_")} & {*self.numbers})


class About(TypedDict, total=False):
    """The fields of a finding that most checks leave empty."""

    numbers: tuple[str, ...]
    flights: tuple[str, ...]
    evidence: tuple[Evidence, ...]
    next_step: str | None
    withheld_because: str | None
    doubtful_because: str | None
    useless_because: str | None


def doubt(kind: str, sentence: str, **about: Unpack[About]) -> Finding:
    """Return a doubt; `about` are further fields of `Finding`."""
    return Finding(kind=kind, severity="doubt", sentence=sentence, **about)


def doubts(kind: str, said: Iterable[str]) -> Iterator[Finding]:
    """Yield a doubt for each of some sentences."""
    return (doubt(kind, sentence) for sentence in said)


def note(kind: str, sentence: str, **about: Unpack[About]) -> Finding:
    """Return a note; `about` are further fields of `Finding`."""
    return Finding(kind=kind, severity="note", sentence=sentence, **about)


def doubt_or_passed(
    kind: str,
    sentence: str | None,
    measured: Mapping[str, float] | None = None,
    **about: Unpack[About],
) -> Finding:
    """Return a doubt where there is a sentence, else that the check passed.

    `kind`: of the check. `sentence`: None where it objects to nothing. `measured`: quantities by
    name. `about`: further fields of `Finding`; a pass has no next step, and no reason to doubt.
    """
    evidence = tuple(Evidence(name=name, value=v) for name, v in (measured or {}).items())
    about = {"evidence": evidence, **about}
    if sentence is not None:
        return doubt(kind, sentence, **about)
    about |= {"next_step": None, "doubtful_because": None}
    return Finding(kind=kind, severity="passed", **about)


def sentences(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the sentences of findings, without those of checks that passed."""
    return tuple(one.sentence for one in findings if one.sentence)


def diagnostics_of(findings: Iterable[Finding]) -> dict[str, float]:
    """Return the quantities behind findings by name."""
    return {name: value for one in findings for name, value in one.diagnostics.items()}


def finding_to_plain(finding: Finding) -> dict[str, Any]:
    """Return a finding as JSON holds it."""
    return asdict(finding)


def finding_from_plain(entry: Mapping[str, Any]) -> Finding:
    """Return a finding of JSON.

    Raises `KeyError`, `TypeError`, `ValueError` if it is not one.
    """
    fields: dict[str, Any] = dict(entry)
    fields["evidence"] = tuple(_evidence_from_plain(one) for one in entry["evidence"])
    for name in ("numbers", "flights"):
        fields[name] = tuple(str(text) for text in entry[name])
    return Finding(**fields)


def _evidence_from_plain(entry: Mapping[str, Any]) -> Evidence:
    fields: dict[str, Any] = dict(entry)
    if entry["interval"] is not None:
        fields["interval"] = tuple(entry["interval"])
    return Evidence(**fields)
