"""Columns that belong to one group of shots each, such as a ball's luck, dealt out.

A shot knows its own group's effects only. So what is kept for each shot has one column an effect, and which group's it
is stands beside it: with many balls and shots, most of a matrix over all columns would be noughts.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

Array = np.ndarray


@dataclass(frozen=True)
class GroupedColumns:
    """A shot's own C columns: `real` that all shots have, then its group's `effects`; of P over all groups, which come
    effect by effect, group by group.

    label [n] numbers each shot's group, below `groups`.
    """

    real: int
    effects: int
    groups: int
    label: Int[Array, " n"]

    @staticmethod
    def plain(shots: int, columns: int) -> "GroupedColumns":
        """Of shots without groups."""
        return GroupedColumns(columns, 0, 0, np.zeros(shots, dtype=int))

    @property
    def width(self) -> int:
        """P"""
        return self.real + self.effects * self.groups

    @cached_property
    def place(self) -> Int[Array, "n C"]:
        """Which of the P each of a shot's own columns is [n, C]."""
        common = np.tile(np.arange(self.real), (len(self.label), 1))
        return np.concatenate([common, self.real + np.arange(self.effects) * self.groups + self.label[:, None]], axis=1)

    def own(self, change: Float[Array, "n P"]) -> Float[Array, "n C"]:
        """Each shot's own columns."""
        return np.take_along_axis(change, self.place, axis=1) if self.effects else change

    def spread(self, own: Float[Array, "n C"]) -> Float[Array, "n P"]:
        """All columns, zero in those of other groups."""
        if not self.effects:
            return own
        spread = np.zeros((len(own), self.width))
        np.put_along_axis(spread, self.place, own, axis=1)
        return spread

    def some(self, rows: Int[Array, " k"] | Bool[Array, " n"]) -> "GroupedColumns":
        """Of some shots."""
        return replace(self, label=self.label[rows])

    def total(self, own: Float[Array, "n C C"]) -> Float[Array, "P P"]:
        """Sum [P, P] over shots of own [n, C, C]."""
        real = self.real
        total = np.zeros((self.width, self.width))
        total[:real, :real] = own[:, :real, :real].sum(0)
        for effect in range(real, real + self.effects):
            np.add.at(total, self.place[:, effect], self.spread(own[:, effect]))
        total[:real, real:] = total[real:, :real].T
        return total

    def pick(self, kept: Int[Array, " k"]) -> tuple["GroupedColumns", Int[Array, " c"]]:
        """(deal, which own columns) of these columns, those of all shots first; of groups all or none."""
        real = kept[kept < self.real]
        effects = self.effects if len(kept) > len(real) else 0
        deal = GroupedColumns(len(real), effects, self.groups if effects else 0, self.label)
        return deal, np.concatenate([real, self.real + np.arange(effects)])
