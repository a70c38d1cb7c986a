"""What every section of the configuration has in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """Frozen; an unknown key, nan and inf are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
