"""What the numbers and texts may be that a run folder's JSON files hold."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

#: Text of one line, that no terminal takes for a command.
Text = Annotated[str, Field(max_length=2**16, pattern=r"^[^\p{Cc}]*$")]
FileName = Annotated[str, Field(max_length=255, pattern=r"^[^\p{Cc}/\\]+$")]
Digest = Annotated[str, Field(pattern=r"^(sampled:)?[0-9a-f]{64}$")]
Moment = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,9})?Z$")]
Count = Annotated[int, Field(ge=0, le=10**9)]
#: The number of a channel; some interrogators count from before their first one.
Channel = Annotated[int, Field(ge=-(10**9), le=10**9)]
Size = Annotated[float, Field(ge=0)]
Spread = Annotated[float, Field(ge=0, le=1e6)]
Positive = Annotated[float, Field(gt=0, le=1e9)]
#: Samples a second.
Rate = Annotated[float, Field(ge=0.01, le=1e5)]
#: Meters of gauges, between channels and knots.
Length = Annotated[float, Field(ge=0.01, le=1e4)]
#: A place, m, or a channel, which may lie between two.
Place = Annotated[float, Field(ge=-1e8, le=1e8)]
#: A number of which null says that it is not known; NaN then.
Maybe = Annotated[float | None, AfterValidator(lambda value: float("nan") if value is None else value)]


class Stored(BaseModel):
    """What a JSON file of a run holds: finite numbers, no conversions, no other keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
