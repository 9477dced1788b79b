# SPDX-License-Identifier: Apache-2.0
"""Import of telemetry from third-party files, bags and topics."""
