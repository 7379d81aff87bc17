"""`[plan]` of site.toml: a survey that nobody has driven yet."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from solver.survey.limits import FASTEST, VEHICLE_REACH

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]

#: Mass of a vehicle of each class, kg: means of makers' data sheets, half laden.
MASSES = {"car": 1400.0, "van": 2300.0, "truck": 8000.0, "bus": 13000.0}
#: m of road that are planned at once: what one camera sees, and one fit holds.
LONGEST = 200.0
#: Vehicles of a plan at most; more hardly say more.
MOST_VEHICLES = 60

VehicleClass = Literal["car", "van", "truck", "bus"]


def or_a_file(schema: dict[str, Any]) -> None:
    """Let a value of site.toml be the name of a file of a map in its place, see `solver.survey.plan_maps`."""
    kept = {name: schema.pop(name) for name in ("type", "items", "minItems") if name in schema}
    schema["anyOf"] = [kept, {"type": "string", "format": "path"}]


class Table(BaseModel):
    """A table of site.toml; keys it does not have are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class LaneSection(Table):
    """One lane: where its middle is, which way its vehicles go, how many of each class go by."""

    y: Finite
    toward: Literal["+x", "-x"]
    vehicles: dict[VehicleClass, Annotated[int, Field(ge=0)]] = {}

    @property
    def direction(self) -> int:
        """+1 along x, -1 against it."""
        return 1 if self.toward == "+x" else -1


class PlanSection(Table):
    """`[plan]`: the traffic, the fiber as it is expected, and the noise."""

    length: Annotated[float, Field(ge=20, le=LONGEST)]
    offset: Finite
    lanes: Annotated[list[LaneSection], Field(min_length=1, json_schema_extra=or_a_file)]
    snr_db: Finite | None = None
    noise: Positive | None = None
    speeds: tuple[Positive, Positive] = (30.0, 60.0)
    sampling_rate: Annotated[float, Field(ge=1)] = 20.0
    fix_sigma: Positive = 0.06
    frame_rate: Annotated[float, Field(ge=1, le=120)] = 12.5
    shear_modulus: Positive = 6e7
    anchors: Annotated[list[Finite], Field(json_schema_extra=or_a_file)] = []
    anchor_sigma: Positive = 0.05

    @field_validator("speeds")
    @classmethod
    def drivable(cls, speeds: tuple[float, float]) -> tuple[float, float]:
        """Refuse speeds, km/h, that are not in order, or that no vehicle drives."""
        low, high = speeds
        if not 4 <= low <= high <= 3.6 * FASTEST:
            raise ValueError(f"{[low, high]}; give the slowest and the fastest in km/h, as [30, 60]")
        return speeds

    @model_validator(mode="after")
    def complete(self) -> "PlanSection":
        """Refuse a plan without traffic, without noise, or with a fiber that no lane is near."""
        if not 0 < self.vehicles <= MOST_VEHICLES:
            raise ValueError(
                f"lanes have {self.vehicles} vehicles; give 1 to {MOST_VEHICLES}, as {{ car = 4, truck = 1 }}"
            )
        if (self.snr_db is None) == (self.noise is None):
            raise ValueError("give one of snr_db (of the passes' maps, dB) and noise (of a sample, 1/s)")
        nearest = min(abs(lane.y - self.offset) for lane in self.lanes)
        if nearest > VEHICLE_REACH:
            raise ValueError(
                f"the fiber at offset {self.offset:g} m is {nearest:.0f} m from the nearest lane; no "
                f"channel records one from beyond {VEHICLE_REACH:g} m"
            )
        if any(not 0 <= x <= self.length for x in self.anchors):
            raise ValueError(f"anchors: give x of each between 0 and length ({self.length:g} m)")
        return self

    @property
    def vehicles(self) -> int:
        """How many go by."""
        return sum(sum(lane.vehicles.values()) for lane in self.lanes)
