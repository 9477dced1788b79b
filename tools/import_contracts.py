"""Contract types for import-linter."""

import sys
from fnmatch import fnmatch

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class OnlyContract(Contract):
    """``modules`` import themselves, ``allowed`` and the standard library, and nothing else.

    What is allowed is a package with all that is in it, or one module.

    Modules that match a pattern of ``apart_from`` may import what they like, and may not be
    imported by the others.
    """

    type_name = "only"

    modules = fields.ListField(subfield=fields.StringField())
    allowed = fields.ListField(subfield=fields.StringField())
    apart_from = fields.ListField(subfield=fields.StringField(), required=False, default=[])

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Collect the imports from elsewhere."""
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
    """No module imports a package that contains it.

    Without such imports, and without circles between siblings, there is no circle of modules.
    """

    type_name = "containers"

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Collect the imports of containing packages."""
        inward = [
            f"{importer} -> {imported}"
            for importer in sorted(graph.modules)
            for imported in sorted(graph.find_modules_directly_imported_by(importer))
            if importer.startswith(f"{imported}.")
        ]
        return ContractCheck(kept=not inward, metadata={"inward": inward})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print the imports of containing packages."""
        for found in check.metadata["inward"]:
            output.print_error(f"- {found}", bold=False)
        output.new_line()
