# SPDX-License-Identifier: Apache-2.0
"""Tables, pictures and progress on a terminal."""
