"""Which sources of poses keep saying otherwise than the estimate."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Discord:
    """A source of poses that says otherwise than the estimate again and again, and is not fused.

    Args:
        source: name of the sensor, or "amcl".
        sigma: how far off its newest pose is, in standard deviations of both together (Mahalanobis distance).
        since: s, stamp of the first pose of this spell.
        times: how many poses in a row.
    """

    source: str
    sigma: float
    since: float
    times: int


class Refusals:
    """Keeps, source by source, how long poses have been refused; a discord is what lasts for `patience` poses."""

    def __init__(self, patience: int = 3) -> None:
        self._patience = patience
        self._spells: dict[str, Discord] = {}

    def note(self, source: str, stamp: float, sigma: float, *, refused: bool) -> None:
        """Take in what became of a pose."""
        if not refused:
            self._spells.pop(source, None)
            return
        spell = self._spells.get(source)
        since, times = (stamp, 1) if spell is None else (spell.since, spell.times + 1)
        self._spells[source] = Discord(source=source, sigma=float(sigma), since=since, times=times)

    @property
    def discords(self) -> tuple[Discord, ...]:
        """In the order in which they began."""
        return tuple(spell for spell in self._spells.values() if spell.times >= self._patience)
