"""What a person wants to see while an advisor is asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from swim2real.advisor.vlm.transcript import Totals

Kind = Literal["asks", "waits", "received", "answered", "unusable", "failed", "warning"]


@dataclass(frozen=True)
class AdvisorEvent:
    """One step of a round.

    Attributes:
        kind: `asks` when a call begins, `waits` while it lasts, `received` or `failed` when it ends; then `answered`
            when the reply is used or `unusable` when it has to be mended; `warning` for what a person should know.
        round: From 1 on.
        text: A sentence.
        totals: Of the run so far.
    """

    kind: Kind
    round: int
    text: str
    totals: Totals
