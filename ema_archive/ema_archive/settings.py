# SPDX-License-Identifier: Apache-2.0
"""Inputs that determine an archive's results: stored settings and software version."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import Any, Self

from ema_core.growth_laws import GROWING_LAWS
from ema_core.source_digest import source_digest
from ema_monitor.health import HealthLimits
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.model.measurements import MAX_AGE_S
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.growth.tracker_settings import KnownLaw, TrackerSettings
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.windows.trigger import TriggerSettings


@cache
def estimation_software() -> str:
    """Return a digest of all source code that bag estimates depend on."""
    return source_digest(["ema_archive.bag_task"])


@cache
def prognosis_software() -> str:
    """Return a digest of all source code that health and life depend on."""
    return source_digest(["ema_archive.unit_task"])


@dataclass(frozen=True)
class ArchiveSettings:
    """Settings with which an archive is computed."""

    calibration: str = ""
    """Path of the calibrations, with placeholders ``{actuator_id}`` and ``{serial_number}``. If it
    is empty, ``calibration.yaml`` in the folder of the bag is used, or else the shipped
    calibration."""
    trigger: TriggerSettings = field(default_factory=TriggerSettings)
    """Trigger settings that define the windows of a bag."""
    measured_max_age_s: float = MAX_AGE_S
    """Largest age of a recorded measurement of a hidden cause at the start of a window [s]."""
    search: SearchSettings = field(default_factory=lambda: SearchSettings(warm_start=False))
    """Settings of the fault search. Every search starts cold, so that a bag's estimates depend only
    on that bag."""
    prognosis: PrognosisSettings = field(default_factory=PrognosisSettings)
    """Settings of health and life."""

    @property
    def estimation_id(self) -> str:
        """Identity of the settings that determine estimates."""
        values = self.as_mapping()
        return _digest({name: values[name] for name in ("trigger", "measured_max_age_s", "search")})

    @property
    def prognosis_id(self) -> str:
        """Identity of the settings that determine health and life."""
        return _digest(self.as_mapping()["prognosis"])

    def as_mapping(self) -> dict[str, Any]:
        """Return the settings as plain values for `of_mapping`.

        Raises
        ------
        ValueError
            If a growth law is not a known law with a name.
        """
        for component, prior in self.prognosis.tracker.laws.items():
            if not isinstance(prior.law, str):
                raise ValueError(
                    f"law {prior.law} of {component}: an archive stores laws by name, expected one "
                    f"of {', '.join(GROWING_LAWS)}"
                )
        values = asdict(self)
        # An archive has no data on other units.
        del values["prognosis"]["tracker"]["fleet"]
        return values

    @classmethod
    def of_mapping(cls, values: Mapping[str, Any]) -> Self:
        """Return settings from plain values; raise ValueError, KeyError or TypeError if invalid."""
        prognosis = values["prognosis"]
        tracker = dict(prognosis["tracker"])
        laws = {name: KnownLaw(**law) for name, law in tracker.pop("laws").items()}
        return cls(
            values["calibration"],
            TriggerSettings(**values["trigger"]),
            values["measured_max_age_s"],
            SearchSettings(**values["search"]),
            PrognosisSettings(
                HealthLimits(**prognosis["limits"]),
                RequirementLimits(**prognosis["requirements"]),
                TrackerSettings(laws=laws, **tracker),
                Service(**prognosis["service"]),
                damage=DamageSettings(**prognosis["damage"]),
            ),
        )


def _digest(values: Any) -> str:
    text = json.dumps(values, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
