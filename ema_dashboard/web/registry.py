"""Write what the page has to know of the registries of faults and hidden causes.

Run by ``make page``; tests/web compares the file with the registries.
"""

import json
from pathlib import Path
from typing import Any, Final

from ema_core.causes import CAUSE_BY_NAME
from ema_core.faults import FAULTS

FILE: Final = Path(__file__).parent / "src/registry.json"


def registry() -> dict[str, Any]:
    """Return names, words and scales of faults, and words of hidden causes."""
    faults = [
        {
            "name": one.name,
            "label": one.label,
            "healthy": one.healthy,
            "highest": one.highest,
            "twoSided": one.is_two_sided,
            "assessed": one.limit is not None,
            "quantity": one.quantity,
            "base": one.base,
            "slope": one.slope,
            "unit": one.unit,
        }
        for one in FAULTS
    ]
    return {
        "faults": faults,
        "causes": {name: cause.label for name, cause in CAUSE_BY_NAME.items()},
    }


if __name__ == "__main__":
    FILE.write_text(json.dumps(registry(), indent=1, ensure_ascii=False) + "\n")
