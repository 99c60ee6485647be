"""Estimates of one machine beside each other: what wear, payload or another setting has changed, and whether it is more
than the bands allow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.api.values import InertiaTable
from schwung.errors import InputError
from schwung.service.records import ResultRecord

#: A difference is more than chance where it exceeds so many standard deviations of both curves together.
SIGMAS = 2.0
_ANGLES = 200


@dataclass(frozen=True)
class Compared:
    """One estimate against the first, over the angles that both have measured. `beyond`: share of these angles
    where the two differ by more than their bands allow; None where one has no band."""

    estimate_id: str
    run_id: str
    created: str
    verdict: str | None
    mean_kgm2: float
    change: float | None  # of the mean, as a share; None: the first, or no angle in common
    largest_kgm2: float | None
    at_rad: float | None  # where that is
    beyond: float | None


def compare(records: Sequence[ResultRecord]) -> list[Compared]:
    """All against the first. Raises InputError for fewer than two."""
    if len(records) < 2:
        raise InputError("estimates", "are fewer than two", "Name two or more.")
    first = table_of(records[0].document)
    return [_against(first, record, record is records[0]) for record in records]


def table_of(document: Mapping[str, Any]) -> InertiaTable:
    """The table in an estimate's document."""
    table = document["table"]
    std = table.get("std_kgm2")
    whole = std is not None and all(value is not None for value in std)
    return InertiaTable(
        np.array(table["position_rad"], dtype=float), np.array(table["inertia_kgm2"], dtype=float),
        np.array(std, dtype=float) if whole else None,
    )  # fmt: skip


def _against(first: InertiaTable, record: ResultRecord, is_first: bool) -> Compared:
    table = table_of(record.document)
    head = (record.id, record.run_id, record.created, record.verdict, float(np.mean(table.inertia_kgm2)))
    low = max(first.position_rad[0], table.position_rad[0])
    high = min(first.position_rad[-1], table.position_rad[-1])
    if is_first or low >= high:
        return Compared(*head, None, None, None, None)
    angles = np.linspace(low, high, _ANGLES)
    before, after = first.at(angles), table.at(angles)
    difference = after - before
    worst = int(np.argmax(np.abs(difference)))
    beyond = None
    if first.std_kgm2 is not None and table.std_kgm2 is not None:
        stds = (
            np.interp(angles, t.position_rad, t.std_kgm2) for t in (first, table) if t.std_kgm2 is not None
        )
        allowed = SIGMAS * np.sqrt(sum(std**2 for std in stds))
        beyond = float(np.mean(np.abs(difference) > allowed))
    change = float(np.mean(difference) / np.mean(before))
    return Compared(*head, change, float(np.abs(difference[worst])), float(angles[worst]), beyond)
