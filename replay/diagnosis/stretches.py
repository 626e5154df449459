"""Which stretches of a log of many hours are judged: a search needs some hundred MiB for an hour of flight."""

from __future__ import annotations

from replay.residual.record import Record

MOST_S = 2.0 * 3600.0
"""Of one log. More changes little in what is known of a vehicle, and two hours need 1.5 GiB."""


class Stretches:
    """Records of a log in their order; of a long one every second, fourth ... stretch, so that they cover all of it."""

    def __init__(self) -> None:
        self.records: list[Record] = []
        self._met = 0
        self.one_of = 1
        """Of so many stretches one is judged."""

    def wants_next(self) -> bool:
        """Whether the next stretch is to be judged."""
        self._met += 1
        return (self._met - 1) % self.one_of == 0

    def add(self, record: Record) -> None:
        """Keep a record; where they are too much together, every second one is dropped."""
        self.records.append(record)
        while len(self.records) > 1 and sum(r.seconds for r in self.records) > MOST_S:
            del self.records[1::2]
            self.one_of *= 2

    def notes(self) -> list[str]:
        """What was left out, in words."""
        if self.one_of == 1:
            return []
        hours = sum(r.seconds for r in self.records) / 3600.0
        return [
            f"a long log: one of every {self.one_of} stretches was judged, {hours:.1f} h in all; "
            "cut the log to judge a certain part of it"
        ]
