"""The thesis's study of optimizers, reproduced: runs, tables, figures and report."""
