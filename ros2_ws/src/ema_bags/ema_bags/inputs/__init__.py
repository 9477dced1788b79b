"""Telemetry from third-party files, bags and topics."""
