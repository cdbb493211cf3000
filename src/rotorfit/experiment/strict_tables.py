"""What the tables of the experiment file are made of: strict numbers, and no unknown keys."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

# Strict: neither true nor "1.285" is a number.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Finite, Field(gt=0)]
NotNegative = Annotated[Finite, Field(ge=0)]
Vector = tuple[Finite, Finite, Finite]


class Strict(BaseModel):
    """A table: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)
