"""What the results of an archive follow from: settings that a file keeps, and the software."""

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
    """Return a digest of all sources that the estimates of a bag depend on."""
    return source_digest(["ema_archive.bag_task"])


@cache
def prognosis_software() -> str:
    """Return a digest of all sources, other than the estimates', for health and life."""
    return source_digest(["ema_archive.unit_task"])


@dataclass(frozen=True)
class ArchiveSettings:
    """What an archive is computed with.

    Attributes
    ----------
    calibration
        Path of the calibrations, in which ``{actuator_id}`` and ``{serial_number}`` are replaced by
        the unit's; when empty, ``calibration.yaml`` in a bag's folder, or else the shipped one.
    trigger
        Which windows of a bag are looked at.
    measured_max_age_s
        Age up to which a recorded measurement of a hidden cause holds for a window [s].
    search
        How faults are searched in a window. Each search begins cold, so that the estimates of a bag
        follow from that bag alone.
    prognosis
        Settings of health and life, in addition to the estimates.
    """

    calibration: str = ""
    trigger: TriggerSettings = field(default_factory=TriggerSettings)
    measured_max_age_s: float = MAX_AGE_S
    search: SearchSettings = field(default_factory=lambda: SearchSettings(warm_start=False))
    prognosis: PrognosisSettings = field(default_factory=PrognosisSettings)

    @property
    def estimation_id(self) -> str:
        """Identity of the settings of the estimates."""
        values = self.as_mapping()
        return _digest({name: values[name] for name in ("trigger", "measured_max_age_s", "search")})

    @property
    def prognosis_id(self) -> str:
        """Identity of the settings of health and life."""
        return _digest(self.as_mapping()["prognosis"])

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values, for `of_mapping`."""
        for component, known in self.prognosis.tracker.laws.items():
            if not isinstance(known.law, str):
                raise ValueError(
                    f"law {known.law} of {component}: an archive stores laws by name, expected one "
                    f"of {', '.join(GROWING_LAWS)}"
                )
        values = asdict(self)
        # An archive knows no other units.
        del values["prognosis"]["tracker"]["fleet"]
        return values

    @classmethod
    def of_mapping(cls, values: Mapping[str, Any]) -> Self:
        """Return the settings of plain values; raise ValueError, KeyError or TypeError for none."""
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
