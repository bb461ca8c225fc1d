"""Models of the files of a run folder, wherever they come from: settings, record and outcome.

What is checked here is what is read again; keys that a later version adds are kept as they are.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from swim2real.calibration.from_rest import FromRest
from swim2real.calibration.sensitivity import Sensitivity
from swim2real.formatting import html_table, significant
from swim2real.objective.figures import Fact, FitFigures, Text
from swimbase.checking import Number

if TYPE_CHECKING:
    import pandas as pd

Whole = Annotated[int, Field(strict=True, ge=0, le=10**9)]
Kind = Literal["good", "not finished", "not usable"]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="allow")


class Proposal(_Part):
    """Proposal of an advisor."""

    point: list[Number]
    diagnosis: Text = ""
    reasoning: Text = ""
    notes: dict[str, Any] = {}


class _Note(_Part):
    """Origin of a candidate."""

    source: Text | None = None
    start: Whole | None = None
    stage: Whole | Text | None = None  # of a descent, or its name in a plan of stages
    last: bool = False  # whether it is the last stage
    round: Whole | None = None
    step_size: Number | None = None
    parameter: Text | Whole | None = None  # a name, or an index of the cube
    proposal: Proposal | None = None


class RecordedEvaluation(_Part):
    """A line of the record."""

    index: Whole
    loss: Number
    failed: Annotated[bool, Field(strict=True)]
    reason: Text | None = None
    point: list[Share]
    values: dict[str, Number]
    note: _Note
    evidence: FitFigures
    seconds: Number | None = None


class TrialSummary(_Part):
    """Findings in a real trial."""

    usable: bool | None = None
    findings: list[Text] = []
    duration: Fact = None
    frames: Whole | None = None
    frequency: Fact = None
    frequency_std: Fact = None
    phase: Fact = None
    phase_std: Fact = None
    start_speed: Fact = None
    start_speed_std: Fact = None
    amplitude: Fact = None
    explained: Fact = None
    nominal_frequency: Fact = None
    meters_per_pixel: Fact = None
    lost_share: list[Fact] = []
    left_out_share: Fact = None
    head_spread: Fact = None
    body_spread: Fact = None
    controls: list[Text] = []
    sensors: list[Text] = []


class Verdict(_Part):
    """Verdict on what a run's best parameters are worth.

    Attributes:
        kind: `good`: near the noise, or nothing further explains the trials. `not finished`: a further search probably
            explains more. `not usable`: too much is unexplained, or a simulation goes wrong.
        sentence: Reason, with numbers, and what would help.
        unexplained: Share of the real motion that the fit leaves unexplained; None where nothing was simulated.
        seconds: Time that a search would probably still take [s]; None for one that is done.
    """

    kind: Kind
    sentence: Text
    unexplained: Number | None = None
    seconds: Number | None = None

    @property
    def title(self) -> str:
        """Kind, as it is shown."""
        return self.kind.capitalize()


class Outcome(_Part):
    """Findings of a run: the content of its `outcome.json`.

    Attributes:
        fit: Figures on the fitted trials.
        verdict: What the best parameters are worth; None in runs of before there was one.
        values: The best parameters, by name.
        held_out: Figures on the held-out trials; None without any.
        from_rest: How each fitted trial's beat swims from rest; empty where trials have no beat.
        trials: What was found in each real trial.
        sensitivity: Effect of each parameter on the loss; None where nobody asked for it.
        engine: Name and fingerprint of the physics engine.
        marker_names: Names of the markers.
        evaluations: Number of evaluations on record.
        ending: What ended the search: done, most, budget, minutes, stopped or interrupted.
        conclusion: Reason why it is done, in words; empty otherwise.
        noise: Noise of the markers of the fitted trials, of sensors alone that of what they count as [m].
        ranges: Values of each parameter within which the error rises by less than a tenth, others following; empty
            where the search has no slopes.
        late: A sentence for each stream of commands or readings that seems late.
    """

    fit: FitFigures
    verdict: Verdict | None = None
    values: dict[str, Number] = {}
    held_out: FitFigures | None = None
    from_rest: dict[str, FromRest] = {}
    trials: dict[str, TrialSummary] = {}
    sensitivity: list[Sensitivity] | None = None
    engine: dict[str, object] = {}
    marker_names: list[Text] = []
    evaluations: Whole = 0
    ending: Text = "budget"
    conclusion: Text = ""
    noise: Number | None = None
    ranges: dict[str, tuple[Number, Number]] = {}
    late: list[Text] = []

    def __repr__(self) -> str:
        error = "diverged" if self.fit.error is None else f"{1e3 * self.fit.error:.3g} mm"
        kind = "" if self.verdict is None else f"{self.verdict.kind}, "
        return f"<Outcome: {kind}{error} after {self.evaluations} evaluations, {len(self.values)} values>"

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        rows = [
            (name, significant(value), " to ".join(map(significant, self.ranges[name])) if name in self.ranges else "–")
            for name, value in self.values.items()
        ]
        said = "" if self.verdict is None else f"{self.verdict.title}: {self.verdict.sentence}."
        return html_table(said, ("parameter", "value", "fits about as well"), rows)

    def to_dataframe(self) -> pd.DataFrame:
        """The best parameters by name: `value`, and `low` and `high`, between which it fits about as well."""
        import pandas as pd

        ends = [self.ranges.get(name, (math.nan, math.nan)) for name in self.values]
        low, high = ([both[k] for both in ends] for k in (0, 1))
        columns = {"value": list(self.values.values()), "low": low, "high": high}
        return pd.DataFrame(columns, index=pd.Index(list(self.values), name="parameter"))

    def to_json(self) -> dict[str, object]:
        """As the file has it."""
        return self.model_dump(exclude_unset=True)
