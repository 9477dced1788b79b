"""Import of telemetry from third-party files, bags and topics."""
