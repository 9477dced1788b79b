"""Reports of a unit as one page that needs nothing beside it."""
