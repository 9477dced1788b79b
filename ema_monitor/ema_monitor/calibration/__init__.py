"""The unit's own model: fitted on healthy windows, stored and aligned."""
