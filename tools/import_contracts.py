# SPDX-License-Identifier: Apache-2.0
"""Contract types for import-linter."""

import sys
from fnmatch import fnmatch

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class OnlyContract(Contract):
    """Contract that ``modules`` import only themselves, ``allowed`` and the standard library.

    An item of ``allowed`` is a package including its submodules, or a single module.

    Modules that match a pattern of ``apart_from`` may import anything, but the remaining modules
    must not import them.
    """

    type_name = "only"

    modules = fields.ListField(subfield=fields.StringField())
    allowed = fields.ListField(subfield=fields.StringField())
    apart_from = fields.ListField(subfield=fields.StringField(), required=False, default=[])

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Collect the imports that are not allowed."""
        options = self.contract_options
        allowed = {*options["allowed"], *sys.stdlib_module_names}
        strangers = []
        for module in options["modules"]:
            family = {
                name
                for name in (module, *graph.find_descendants(module))
                if not any(fnmatch(name, pattern) for pattern in options.get("apart_from", ()))
            }
            for importer in sorted(family):
                for imported in sorted(graph.find_modules_directly_imported_by(importer) - family):
                    if not allowed & {imported, imported.partition(".")[0]}:
                        strangers.append(f"{importer} -> {imported}")
        return ContractCheck(kept=not strangers, metadata={"strangers": strangers})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print the imports that are not allowed."""
        for stranger in check.metadata["strangers"]:
            output.print_error(f"- {stranger}", bold=False)
        output.new_line()


class ContainersContract(Contract):
    """Contract that no module imports a package that contains the module.

    Together with a ban on cycles between siblings, this excludes all import cycles.
    """

    type_name = "containers"

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Collect imports of containing packages."""
        inward = [
            f"{importer} -> {imported}"
            for importer in sorted(graph.modules)
            for imported in sorted(graph.find_modules_directly_imported_by(importer))
            if importer.startswith(f"{imported}.")
        ]
        return ContractCheck(kept=not inward, metadata={"inward": inward})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print the imports of containing packages."""
        for import_ in check.metadata["inward"]:
            output.print_error(f"- {import_}", bold=False)
        output.new_line()
