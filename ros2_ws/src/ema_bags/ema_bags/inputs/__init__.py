"""Telemetry from files, bags and topics of other makes."""
