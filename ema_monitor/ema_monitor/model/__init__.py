"""The monitor model: kernel, drives, threads."""
